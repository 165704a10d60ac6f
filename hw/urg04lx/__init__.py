"""Hokuyo URG-04LX and its sisters: SCIP, from bytes to scans."""
