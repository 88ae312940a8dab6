"""zerobeam: joint offsets of industrial robots from laser shots at one point, and how sure one may be."""

__version__ = "0.1.0"
