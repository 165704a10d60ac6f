"""Coverage-guided fuzzing of all that takes bytes from outside: `make fuzz`, docs/security.md."""
