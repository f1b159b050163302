"""The run loop: one pipeline step for each event of a source; its report goes to every sink."""

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from groundstation.errors import InputError
from groundstation.messages import Event, StepReport
from groundstation.sinks.sink import Sink
from groundstation.tracking.pipeline import Pipeline


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOutcome:
    """Outcome of a run: wall time in s, number of epochs, and the fault that ended it, if any."""

    elapsed_s: float
    epochs: int
    fault: InputError | None


def run_pipeline(
    source: Iterable[Event], pipeline: Pipeline, sinks: Sequence[Sink], on_epoch: Callable[[int], None]
) -> RunOutcome:
    """Feed every event of ``source`` to the pipeline and every report to the sinks.

    A fault of the source ends the run early and is returned, after the pipeline has been drained.
    """
    started = time.perf_counter()
    epochs = 0
    fault = None

    def emit(report: StepReport) -> None:
        nonlocal epochs
        if not report.empty:
            for sink in sinks:
                sink.write(report)
        if report.estimates:
            epochs += len(report.estimates)
            on_epoch(epochs)

    newest_s = 0.0
    try:
        for event in source:
            newest_s = event.t_s
            emit(pipeline.step(event))
        emit(pipeline.finish())
    except InputError as error:
        fault = error
        emit(pipeline.finish())
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        # numerically unusable input: what has been written so far is kept
        got = f"{type(error).__name__} ({error})"
        fault = InputError(f"session time {newest_s:.3f} s", got=got, wanted="values and tuning of a usual size")
    return RunOutcome(elapsed_s=time.perf_counter() - started, epochs=epochs, fault=fault)
