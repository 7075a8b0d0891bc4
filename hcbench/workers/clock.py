"""What a process takes of a processor."""

import os
from pathlib import Path


def processor_seconds(number: int) -> float:
    """What a process and its children took of a processor, s; 0 where the system does not tell."""
    try:
        fields = Path(f"/proc/{number}/stat").read_text(encoding="ascii", errors="replace").rpartition(")")[2]
        return sum(map(int, fields.split()[11:15])) / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, AttributeError):
        return 0.0
