"""Processes: workers that share the work of one command, and how everything stops.

| read | for |
| --- | --- |
| `place` | who does the work of a command: this machine's processes, or a Ray cluster |
| `crew` | what both have in common |
| `pool` | ``Workers``, the processes of this machine |
| `cluster` | ``RayWorkers``, those of a Ray cluster |
| `tied` | processes that end when the one that started them does, however it ends |
| `stop` | SIGTERM and SIGINT in the main program |
"""

from camnet.processes.pool import Workers
from camnet.processes.stop import TerminatedError, stop_on_signals

__all__ = ["TerminatedError", "Workers", "stop_on_signals"]
