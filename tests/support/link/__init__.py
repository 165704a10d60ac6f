"""The planner's link: senders without a mind, receivers that are right and wrong, the C header."""
