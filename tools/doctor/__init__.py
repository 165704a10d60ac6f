"""What `mapod doctor` looks at: each file gives findings, one line each."""
