"""Processor time of a process."""

import os
from pathlib import Path


def processor_seconds(number: int) -> float:
    """Processor time of a process and its children, s; 0 if the system does not report it."""
    try:
        fields = (
            Path(f"/proc/{number}/stat")
            .read_text(encoding="ascii", errors="replace")
            .rpartition(")")[2]
        )
        return sum(map(int, fields.split()[11:15])) / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, AttributeError):
        return 0.0
