"""Processes: workers that share the work of one command, and how everything stops.

| read | for |
| --- | --- |
| `pool` | ``Workers``, the one pool of all commands |
| `tied` | processes that end when the one that started them does, however it ends |
| `stop` | SIGTERM and SIGINT in the main program |
"""

from camnet.processes.pool import Workers
from camnet.processes.stop import TerminatedError, stop_on_signals

__all__ = ["TerminatedError", "Workers", "stop_on_signals"]
