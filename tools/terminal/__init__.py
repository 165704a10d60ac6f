"""Map and words in a terminal, the keyboard, and the processes that a command starts."""
