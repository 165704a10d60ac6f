"""What a person runs beside the app: run, view, replay, bench."""
