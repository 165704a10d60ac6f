"""No drive at all: a robot that something else moves."""
