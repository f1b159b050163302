"""A viewer that does not end on request is killed."""

import os
import signal
import subprocess
import sys
import time

from groundstation.viewer.viewer_process import stop_viewer

DEAF = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print(1, flush=True); time.sleep(600)"


def begun(program: str) -> "subprocess.Popen[bytes]":
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, start_new_session=True)
    assert process.stdout is not None
    process.stdout.readline()
    process.stdout.close()
    return process


def test_one_that_does_not_listen() -> None:
    process = begun(DEAF)
    stop_viewer(process, 0.1)
    assert process.returncode == -signal.SIGKILL


def test_one_that_is_stopped() -> None:
    process = begun("import time; print(1, flush=True); time.sleep(600)")
    os.kill(process.pid, signal.SIGSTOP)
    time.sleep(0.05)
    stop_viewer(process, 0.1)
    assert process.returncode == -signal.SIGKILL


def test_one_that_listens() -> None:
    process = begun("import time; print(1, flush=True); time.sleep(600)")
    stop_viewer(process, 60.0)
    assert process.returncode == -signal.SIGTERM
