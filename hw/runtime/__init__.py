"""Wake-up, timer and real-time rights of the loop."""
