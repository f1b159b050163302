"""A lens calibration as text for the terminal."""

from calibration.lens.advice import LensAdvice
from calibration.lens.intrinsics import Intrinsics
from calibration.lens.model import PARAMETERS
from calibration.lens.view_choice import Choice


def format_intrinsics(found: Intrinsics, advice: LensAdvice) -> str:
    """Return views with their reasons, the lens with its sigmas, verdict and next steps."""
    lens = found.fit.lens
    lines = [f"{len(found.views)} of {len(found.verdicts)} pictures used"]
    lines += [
        f"  {v.name}: {v.choice.value}" + (f" ({v.detail})" if v.detail else "")
        for v in found.verdicts
        if v.choice is not Choice.USED
    ]
    lines.append("")
    values = [*lens.focal_px, *lens.principal_point_px, *lens.distortion]
    for name, value, sigma in zip(PARAMETERS, values, found.fit.sigma, strict=True):
        reported = "held at zero" if sigma == 0 else f"± {sigma:.2g}"
        lines.append(f"  {name:<18} {value:>12.6g} {reported}")
    lines += ["", *advice.notes, "", advice.verdict, "", "next:", *(f"- {step}" for step in advice.next_steps)]
    return "\n".join(lines)
