"""The newest command is kept for the thread that moves the head."""

import threading

from groundstation.live.head_worker import HeadWorker


def test_the_newest_command_replaces_the_one_before() -> None:
    worker = HeadWorker.__new__(HeadWorker)
    worker._lock, worker._command = threading.Lock(), None
    for command in ("first", "second"):
        worker.set_command(command)
        assert worker._command == command
