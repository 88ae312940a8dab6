"""Any text as one line of ASCII: names in comments of files that machines read."""

from __future__ import annotations

import re


def one_line(text: str) -> str:
    """Text that may hold any character, as ASCII on one line; control and other characters as escapes."""
    said = text.replace("±", "+-")
    return re.sub(r"[^ -~]", lambda found: found.group().encode("unicode_escape").decode(), said)
