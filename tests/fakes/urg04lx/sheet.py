"""The replies printed in the URG-04LX's sheet, byte for byte."""

VV = b"""VV
00P
VEND:Hokuyo Automatic Co.,Ltd.;[
PROD:SOKUIKI Sensor URG-04LX;[
FIRM:3.1.00(18/Jan./2007);`
PROT:SCIP 2.0;N
SERI:H0614967;V

"""
PP = b"""PP
00P
MODL:URG-04LX(Hokuyo Automatic Co.,Ltd.);N
DMIN:20;4
DMAX:5600;_
ARES:1024;\\
AMIN:44;7
AMAX:725;o
AFRT:384;6
SCAN:600;e

"""
II = b"""II
00P
MODL:URG-04LX(Hokuyo Automatic Co.,Ltd.);N
LASR:OFF;7
SCSP:Initial(600[rpm])<-Default setting by user;A
MESM:IDLE;:
SBPS:19200[bps]<-Default setting by user;A
TIME:081615;N
STAT:Sensor works well.;8

"""
II_MS = 0x081615  # what the timer shows in it
SIX = {44: 0, 45: 7, 46: 19, 47: 20, 48: 1000, 49: 5600}  # of the scan below
SCAN_MS = 0x012345
MD = b"MD0044004901000\n99b\n0B=5T\n00000700C00D0?X1GPm\n\n"
GS = b"GS0044004900\n00P\n0B=5T\n00070C0D?XooS\n\n"
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
EMPTY = b"SCIP2.0\n0\n\n", b"SCIP2.0\n0Ee\n\n", b"QT\nE\n\n"
