"""An arm as people know it: orientations as pendants show them, reach, numbers that are not plausible."""
