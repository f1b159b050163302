"""Head angles from the picture: drawn ground seen by a head with a noisy encoder; where it does not fit, it says so."""

from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration.panorama.mosaic import Mosaic, PanoramaFrame, make_mosaic
from groundstation.arrays import FloatArray
from groundstation.cli.main import main
from groundstation.errors import InputError, RigError
from groundstation.messages import Frame, PtuSample
from groundstation.picture import as_picture
from groundstation.registration.head_registration import HeadRegistration, RegisteredAngles, RegistrationFault
from groundstation.registration.panorama import PictureRays, halved_grey
from groundstation.rig.rig import Rig, Station
from groundstation.sources.panorama_file import read_panoramas, write_panoramas
from groundstation.tracking.registered_heads import RegisteredHeads
from groundstation.tracking.synchronise import InterpolatedAngles, ReadyFrame
from tests.simulation.small_site import small_rig
from tests.stereo_rig import standing

SIZE = (320, 240)
NOISE_RAD = float(np.radians(0.05))


@cache
def station() -> Station:
    one = small_rig(focal_px=1600.0, size_px=SIZE).stations[0]
    return replace(one, ptu_resolution_rad=0.0, ptu_sigma_rad=NOISE_RAD)


@cache
def rays() -> PictureRays:
    return PictureRays(station())


@cache
def ground() -> FloatArray:
    """Grey levels of the ground, 0.02° a pixel, from 15° left to 15° right and 4° up to 8° down."""
    random = np.random.default_rng(4)
    fine = cv2.GaussianBlur(random.normal(0.0, 1.0, (600, 1500)), (0, 0), 7.0)
    coarse = cv2.GaussianBlur(random.normal(0.0, 1.0, (600, 1500)), (0, 0), 25.0)
    return np.asarray(110.0 + 20.0 * fine / fine.std() + 15.0 * coarse / coarse.std(), dtype=np.float32)


def frame(pan_deg: float, tilt_deg: float, random: np.random.Generator) -> FloatArray:
    """Return what the camera sees, halved, at true angles."""
    towards = np.degrees(rays().directions(rays().rays, np.radians(pan_deg), np.radians(tilt_deg)))
    u, v = ((15.0 - towards[:, 0]) / 0.02).astype(np.float32), ((4.0 - towards[:, 1]) / 0.02).astype(np.float32)
    seen = cv2.remap(ground(), u.reshape(1, -1), v.reshape(1, -1), cv2.INTER_CUBIC)
    grey = np.asarray(seen, dtype=np.float64).reshape(SIZE[1] // 2, SIZE[0] // 2)
    return np.asarray(np.clip(grey + random.normal(0.0, 2.0, grey.shape), 0, 255), dtype=np.float32)


@cache
def mosaic() -> Mosaic:
    random = np.random.default_rng(5)
    frames = []
    for pan in np.linspace(-6.0, 6.0, 9):
        for tilt in (-2.5, -1.0):
            noise = random.normal(0.0, NOISE_RAD, 2)
            angles = np.radians([pan, tilt]) + noise
            frames.append(PanoramaFrame(grey=frame(float(pan), tilt, random), angles_rad=angles))
    return make_mosaic(station(), frames, np.radians(3.0))


@cache
def registration() -> HeadRegistration:
    return HeadRegistration(station(), mosaic().panorama)


@pytest.mark.parametrize(("noise_deg", "bound_deg"), [(0.05, 0.015), (0.6, 0.015)])
def test_the_picture_tells_the_angles_better_than_the_encoder(noise_deg: float, bound_deg: float) -> None:
    """Expected: to hundredths, whether the encoder is off by 0.05° or hardly there: a pixel is 0.036°."""
    random = np.random.default_rng(6)
    errors, sigmas = [], []
    for _ in range(12):
        true = random.uniform((-4.0, -2.4), (4.0, -1.2))
        start = np.radians(true + random.uniform(-1.7, 1.7, 2) * noise_deg)
        found = registration().register_grey(frame(*true.tolist(), random), *start.tolist(), np.radians(noise_deg))
        assert isinstance(found, RegisteredAngles)
        errors.append(np.degrees([found.pan_rad, found.tilt_rad]) - true)
        sigmas.append(np.degrees(found.sigma_rad))
    # what all frames of the panorama are off together is the encoders' mean error, 0.05° over √18
    off = np.array(errors)
    assert np.abs(off).max() < 0.05 / np.sqrt(18) * 3.5 + bound_deg
    scatter = np.sqrt(np.mean((off - off.mean(axis=0)) ** 2))
    assert scatter < bound_deg
    assert scatter < 2.0 * np.mean(sigmas)


def test_frames_of_the_panorama_are_brought_to_fit_each_other() -> None:
    assert mosaic().registered == 18
    assert mosaic().panorama.known.mean() > 0.5


def test_brightness_and_a_passing_aircraft_do_not_matter() -> None:
    random = np.random.default_rng(7)
    grey = 0.8 * frame(1.0, -1.5, random) + 25.0
    grey[60:90, 70:110] = 240.0
    found = registration().register_grey(grey, *np.radians([1.05, -1.46]).tolist(), NOISE_RAD)
    assert isinstance(found, RegisteredAngles)
    assert np.degrees(found.pan_rad) == pytest.approx(1.0, abs=0.05)
    assert np.degrees(found.tilt_rad) == pytest.approx(-1.5, abs=0.05)


def test_what_does_not_fit_is_told() -> None:
    """Expected: sky has no texture, another scene does not fit, a place never seen is unknown, a knock too far."""
    random = np.random.default_rng(8)
    angles = np.radians([0.0, -1.5]).tolist()
    sky = np.asarray(180.0 + random.normal(0.0, 1.0, (120, 160)), dtype=np.float32)
    assert registration().register_grey(sky, *angles, NOISE_RAD) is RegistrationFault.NO_TEXTURE
    other = cv2.GaussianBlur(random.normal(0.0, 1.0, (120, 160)), (0, 0), 3.0)
    other = np.asarray(110.0 + 30.0 * other / other.std(), dtype=np.float32)
    assert registration().register_grey(other, *angles, NOISE_RAD) is RegistrationFault.NO_MATCH
    away = np.radians([60.0, -1.5]).tolist()
    assert registration().register_grey(frame(0.0, -1.5, random), *away, NOISE_RAD) is RegistrationFault.NO_PANORAMA
    near = np.radians([0.12, -1.5]).tolist()
    seen = registration().register_grey(frame(0.0, -1.5, random), *near, np.radians(0.001))
    assert seen is RegistrationFault.TOO_FAR


def test_panoramas_are_read_as_they_are_written(tmp_path: Path) -> None:
    path = tmp_path / "p.npz"
    write_panoramas(path, {"left": mosaic().panorama})
    (found,) = read_panoramas(path).items()
    assert found[0] == "left"
    assert np.abs(found[1].grey - mosaic().panorama.grey).max() <= 0.5
    assert np.array_equal(found[1].known, mosaic().panorama.known)
    assert (found[1].left_rad, found[1].step_rad) == (mosaic().panorama.left_rad, mosaic().panorama.step_rad)
    for content in (b"", b"PK\x03\x04 no archive", path.read_bytes()[:200]):
        (tmp_path / "q.npz").write_bytes(content)
        with pytest.raises(InputError, match=r"q\.npz: got .*; wanted .*calibrate panorama"):
            read_panoramas(tmp_path / "q.npz")
    whole = path.read_bytes()
    for at in range(0, len(whole), max(1, len(whole) // 150)):
        (tmp_path / "q.npz").write_bytes(whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :])
        # a byte that matters to nothing may differ; any other is a fault in words
        with suppress(InputError):
            read_panoramas(tmp_path / "q.npz")
    np.savez(tmp_path / "r.npz", format=np.array("groundstation-panorama/1"), **{"left.grey": np.zeros((3, 3))})
    with pytest.raises(InputError, match=r"r\.npz: left\.known: got nothing"):
        read_panoramas(tmp_path / "r.npz")
    with pytest.raises(InputError, match="No such file"):
        read_panoramas(tmp_path / "none.npz")


GOOD = {
    "format": np.array("groundstation-panorama/1"),
    "left.grey": np.full((4, 6), 90, dtype=np.uint8),
    "left.known": np.ones((4, 6), dtype=np.uint8),
    "left.place": np.array([0.1, 0.05, 1e-3, 0.0]),
}


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("format", np.array("groundstation-panorama/9"), "got 'groundstation-panorama/9'; wanted groundstation-pan"),
        ("format", np.zeros(2), "got an array of \\(2,\\)"),
        ("left.grey", np.zeros((4, 6)), "got float64 of \\(4, 6\\); wanted uint8"),
        ("left.known", np.ones((4, 5), dtype=np.uint8), "got uint8 of \\(4, 5\\); wanted uint8 of \\(4, 6\\), as left"),
        ("left.place", np.array([0.1, 0.05, 1.0, 0.0]), "got 0.1, 0.05, 1.0, 0.0; wanted left, top, step"),
        ("left.place", np.zeros(3), "got float64 of \\(3,\\); wanted float64 of \\(4,\\)"),
        ("left.height", np.zeros(3), "got an unknown key; wanted STATION.grey, .known, .place"),
        ("right.place", np.zeros(4), "right.grey: got nothing"),
    ],
)
def test_an_error_in_a_panorama_names_file_and_key(tmp_path: Path, key: str, value: FloatArray, said: str) -> None:
    path = tmp_path / "p.npz"
    np.savez(path, allow_pickle=False, **GOOD)
    assert list(read_panoramas(path)) == ["left"]
    np.savez(path, allow_pickle=False, **{**GOOD, key: value})
    place = "" if key.startswith("right") else f"{key}: "
    with pytest.raises(InputError, match=rf"p\.npz: {place}{said}"):
        read_panoramas(path)


def test_damaged_bytes_are_told_with_their_key(tmp_path: Path) -> None:
    path = tmp_path / "p.npz"
    np.savez(path, allow_pickle=False, **GOOD)
    whole = path.read_bytes()
    at = whole.index(b"Z" * 24)
    path.write_bytes(whole[:at] + b"?" + whole[at + 1 :])
    with pytest.raises(InputError, match=r"p\.npz: left\.grey: got damaged bytes; wanted .*calibrate panorama"):
        read_panoramas(path)
    np.save(tmp_path / "one.npy", np.zeros(3))
    with pytest.raises(InputError, match=r"one\.npy: got a single array; wanted .*calibrate panorama"):
        read_panoramas(tmp_path / "one.npy")


def ready(pan_deg: float, grey: FloatArray, name: str) -> ReadyFrame:
    image = np.repeat(np.repeat(grey.astype(np.uint8), 2, axis=0), 2, axis=1)
    picture = as_picture(np.repeat(image[:, :, None], 3, axis=2))
    return ReadyFrame(
        record=Frame(t_s=2.0, station=name, epoch=1, image=picture),
        angles=InterpolatedAngles(pan_rad=np.radians(pan_deg), tilt_rad=np.radians(-1.5), variance_share=0.5),
        following=None,
    )


def test_a_frame_gets_its_picture_s_angles_or_keeps_the_encoder_s() -> None:
    """Expected: a reading at the frame's instant, with its own sigma; without a fit nothing but a count and a note."""
    random = np.random.default_rng(9)
    rig = Rig(stations=(station(), replace(station(), name="other")))
    heads = RegisteredHeads(rig, {station().name: mosaic().panorama})
    fused: list[PtuSample] = []
    seen = frame(1.0, -1.5, random)
    better = heads.improve(ready(1.06, seen, station().name), fused.append, standing)
    assert isinstance(better.angles, InterpolatedAngles)
    assert np.degrees(better.angles.pan_rad) == pytest.approx(1.0, abs=0.05)
    (sample,) = fused
    assert sample.t_s == 2.0
    assert sample.sigma_rad is not None
    assert better.angles.variance_share == pytest.approx((sample.sigma_rad / NOISE_RAD) ** 2)
    for same in (ready(1.06, np.full_like(seen, 128.0), station().name), ready(1.06, seen, "other")):
        assert heads.improve(same, fused.append, standing) is same
    assert len(fused) == 1
    assert heads.notes() == [
        f"head angles of {station().name} from the picture in 1 of 2 frames; 1 the encoder's: too little ground in view"
    ]
    with pytest.raises(RigError, match="panorama: got one of station third; wanted some of"):
        RegisteredHeads(rig, {"third": mosaic().panorama})


def test_a_colour_picture_is_halved() -> None:
    picture = np.zeros((6, 8, 3), dtype=np.uint8)
    picture[:, :4] = 200
    assert halved_grey(picture).tolist() == [[200.0, 200.0, 0.0, 0.0]] * 3


def test_a_session_without_ground_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "panorama", str(tmp_path), "--out", str(tmp_path / "p.npz")]) == 1
    assert "rig.toml: got no such file" in capsys.readouterr().err
    assert not (tmp_path / "p.npz").exists()
