"""Studies of 10^5 to 10^8 impacts: flown in parts, on any executor, whole again after any end.

A sweep's folder: `part-*.parquet`, one row an impact, columns as in restitution.csv. What starts with an
underscore is not part of the table: `_sweep.json` says what is swept, with what; `_summary.csv` has a row for
each setting, α and step, brought up to date while it runs; `_loops/` has the kept loops, with every sample.
So `pandas.read_parquet(folder)` reads the table, during the sweep too.
"""

from hcbench.sweep.read import is_sweep, read
from hcbench.sweep.runner import Progress, sweep

__all__ = ["Progress", "is_sweep", "read", "sweep"]
