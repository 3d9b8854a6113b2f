"""How the commands that compute for long end: errors and interruption are one sentence each."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool


class StudyError(RuntimeError):
    """The study cannot go on; the message says why."""


def exit_code(program: str, run: Callable[[], None], what_then: str = 'nothing is kept') -> int:
    """Run a study and return the exit code; `what_then` says what an interruption leaves."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    try:
        run()
    except StudyError as error:
        print(f'{program}: {error}', file=sys.stderr)
        return 1
    except BrokenProcessPool:
        print(f'{program}: a worker process died; {what_then}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f'\n{program}: interrupted; {what_then}')
        return 128 + signal.SIGINT
    return 0
