"""The conformance tests of the planner link, for any receiver: in process or over a port."""
