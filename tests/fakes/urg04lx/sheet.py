"""What the printed replies of the URG-04LX's sheet hold, and its numbers and statuses."""

II_MS = 0x081615  # what the timer shows in the vendor's II
SIX = {44: 0, 45: 7, 46: 19, 47: 20, 48: 1000, 49: 5600}  # of its scans: step -> value
SCAN_MS = 0x012345
STATUSES = (
    b"00P 99b 01Q 02R 03S 04T 05U 06V 07W 10Q 0Aa 0Bb 0Cc 0Dd 0Ee 0Ff 0Gg 0Hh 0Ii 98a".split()
)
NUMBERS = (  # value, characters
    (1234, b"CB"),
    (4095, b"oo"),
    (5432, b"1Dh"),
    (20, b"00D"),
    (0, b"000"),
    (16000000, b"m2@0"),
    (16777215, b"oooo"),
)
