"""The edge tracker: one picture and one pose in, the runway's edges with their covariance out.

Order in a frame: nothing known: Algorithm 1, its best pairs become hypotheses; some hypotheses: each is followed, and
one that proves better than the others over some frames is the runway; the runway known: it is followed, and doubted
where it looks unlike one or is missed, and now and then in any case: then Algorithm 1 may bring a better pair, and the
comparison begins again.
"""

from groundstation.arrays import FloatArray, ImageArray
from groundstation.onboard.edges.config import TrackerConfig
from groundstation.onboard.edges.follow import follow
from groundstation.onboard.edges.hypotheses import Hypothesis, alike, find_pairs, followed, merged, score
from groundstation.onboard.edges.kalman import LineState
from groundstation.onboard.edges.look import Lookout
from groundstation.onboard.edges.pose import CameraPose
from groundstation.onboard.edges.report import EdgeMiss, EdgeReport, EdgeStatus


class EdgeTracker:
    """Follows the runway's edges through the pictures of one camera without distortion.

    Parameters
    ----------
    kappa : intrinsic matrix (3, 3).
    image_size_px : (w, h).
    """

    def __init__(self, kappa: FloatArray, image_size_px: tuple[int, int], config: TrackerConfig) -> None:
        self._lookout = Lookout(kappa=kappa, image_size_px=image_size_px, config=config)
        self._config = config
        self._runway: Hypothesis | None = None
        self._open: list[Hypothesis] = []
        self._compared = 0
        self._unchecked = 0

    def start(self, state: LineState) -> None:
        """Go on from lines that are known."""
        self._runway = Hypothesis(state=state, edges=None, frames=1, missed=0, agreement=1.0, nis=4.0, lost=0.0)
        self._open = []
        self._unchecked = 0

    def step(self, image: ImageArray, pose: CameraPose) -> EdgeReport:
        """Take one picture (h, w, 3) uint8 BGR and its pose."""
        if self._runway is not None:
            return self._track(self._runway, image, pose)
        if self._open:
            self._open = followed(self._lookout, image, pose, self._open)
        return self._compare(image, pose)

    def _track(self, runway: Hypothesis, image: ImageArray, pose: CameraPose) -> EdgeReport:
        """Follow the runway; doubt it where there is reason to, and in any case now and then."""
        step = follow(self._lookout, image, pose, runway.state, thorough=True, marks=runway.marks)
        runway = runway.after(step)
        self._unchecked += 1
        if runway.missed > self._config.coast_frames:
            self._runway, self._open = None, []
            return EdgeReport(status=EdgeStatus.SEARCHING, miss=step.miss, edges=None)
        self._runway = runway
        if self._config.confirm_frames > 1 and self._doubted(runway, image, pose):
            return EdgeReport(status=EdgeStatus.ACQUIRING, miss=step.miss, edges=step.edges)
        status = EdgeStatus.TRACKING if step.miss is EdgeMiss.NONE else EdgeStatus.COASTING
        return EdgeReport(status=status, miss=step.miss, edges=step.edges)

    def _doubted(self, runway: Hypothesis, image: ImageArray, pose: CameraPose) -> bool:
        """Return whether Algorithm 1 brings a better pair; all are compared anew if so."""
        config = self._config
        strange = runway.missed >= config.doubt_missed or runway.agreement < config.doubt_agreement
        strange = strange or score(runway, config) < config.doubt_score
        wait = config.doubt_frames if strange else config.check_frames
        if self._unchecked < wait:
            return False
        self._unchecked = 0
        found = find_pairs(self._lookout, image, pose, [runway])
        if isinstance(found, EdgeMiss):
            return False
        own = score(runway, config) + config.margin
        rivals = [h for h in found if not alike(h, runway) and score(h, config) > own]
        if not rivals:
            return False
        self._open, self._runway, self._compared = merged(self._lookout, [runway], rivals), None, 0
        return True

    def _compare(self, image: ImageArray, pose: CameraPose) -> EdgeReport:
        """Add what Algorithm 1 finds to the hypotheses, and choose where one is clearly the best."""
        config = self._config
        found = find_pairs(self._lookout, image, pose, self._open)
        if isinstance(found, EdgeMiss):
            if not self._open:
                return EdgeReport(status=EdgeStatus.SEARCHING, miss=found, edges=None)
        else:
            self._compared = self._compared if self._open else 0
            self._open = merged(self._lookout, self._open, found)
        self._compared += 1
        best = self._open[0]
        proved = best.frames >= config.confirm_frames and best.missed == 0 and self._compared >= config.confirm_frames
        if proved and config.confirm_frames > 1:
            others = [h for h in self._open[1:] if 2 * h.frames >= config.confirm_frames]
            ahead = score(best, config) - max((score(h, config) for h in others), default=-1e9)
            proved = ahead >= config.margin and best.agreement >= config.doubt_agreement
        if proved:
            self._runway, self._open, self._unchecked = best, [], 0
        miss = EdgeMiss.NONE if best.missed == 0 else EdgeMiss.FAINT
        return EdgeReport(status=EdgeStatus.TRACKING if proved else EdgeStatus.ACQUIRING, miss=miss, edges=best.edges)
