"""Loading compiled kernels without numba's events for LLVM's lock, which take a third of the time of it.

llvmlite takes a lock at each call into LLVM, and numba builds and passes on two events each time, to state in a
kernel's metadata how long the lock was held. To read a replay's 67 kernels from numba's cache takes 24,000 such
calls: 1.5 s of a core with the events, 1.0 s without them (2026-11, numba 0.68, llvmlite 0.50).
"""


def drop_lock_events() -> None:
    """Unregister numba's events from LLVM's lock, in this process; the lock itself stays.

    Nothing changes where numba was asked for a trace of its events (``NUMBA_CHROME_TRACE``), or where llvmlite keeps
    the callbacks elsewhere than the versions known do.
    """
    # numba registers them when it is imported
    from numba.core import config

    if getattr(config, "CHROME_TRACE", ""):
        return
    from llvmlite.binding import ffi

    lock = getattr(ffi.lib, "_lock", None)
    for taken, released in tuple(getattr(lock, "_cblist", ())):
        if taken.__module__.startswith("numba."):
            ffi.unregister_lock_callback(taken, released)
