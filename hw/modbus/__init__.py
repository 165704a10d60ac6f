"""The register image and its server."""
