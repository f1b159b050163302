"""The arithmetic of the filter by its configuration: compiled kernels, or filterpy's classes (`FilterImplementation`).

Both share the models: layout, motion, pixel, width and reference models with their Jacobians, gates and noise, the
weighting out of view, the start of a target, the journal and late data. What is exchanged is prediction, mixing, update
and mode probabilities, the update with a PTU reading, and the step of the smoother.
"""

from collections.abc import Callable
from dataclasses import dataclass

from groundstation.estimation.config import EstimationConfig, FilterImplementation
from groundstation.estimation.imm import ImmFilter
from groundstation.estimation.smoother_history import SmoothAcross, smooth_across
from groundstation.estimation.state_model import StateLayout
from groundstation.estimation.updates.encoder_update import EncoderUpdate
from groundstation.estimation.updates.numpy_encoder_update import NumpyEncoderUpdate


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterArithmetic:
    """Interacting multiple model filter, update with the readings of one PTU, and step of the smoother."""

    imm: type[ImmFilter]
    encoder: Callable[[StateLayout, str, EstimationConfig], EncoderUpdate]
    smooth_across: SmoothAcross


_COMPILED = FilterArithmetic(imm=ImmFilter, encoder=EncoderUpdate, smooth_across=smooth_across)


def filter_arithmetic(implementation: FilterImplementation) -> FilterArithmetic:
    """Return the arithmetic of an implementation."""
    if implementation is FilterImplementation.COMPILED:
        return _COMPILED
    # filterpy brings scipy.stats, 0.4 s of a core that a station's processes start without
    from groundstation.estimation.filterpy_imm import FilterpyImm
    from groundstation.estimation.filterpy_smoother import rts_step

    return FilterArithmetic(imm=FilterpyImm, encoder=NumpyEncoderUpdate, smooth_across=rts_step)
