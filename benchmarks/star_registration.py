"""Head angles from rendered frames of drawn nights, by the stars, against the truth and against noisy encoders.

    python benchmarks/star_registration.py [--nights N] [--first N] [--pictures N] [--operation]

The head is calibrated exactly; each picture has noise, hot pixels, clouds in a quarter of them, satellites and aircraft
in some. Encoders have 0.01° of noise, and are then withheld but for ±0.5°. Printed are rms errors of pan and tilt, what
is stated, (error over sigma)², the largest error, why frames had none, and what a frame took of a processor.
With --operation as `live` does it: the twenty brightest dots alone, and no solver.
"""

import argparse
import time
from collections import Counter

import numpy as np

from calibration.stars.simulated.night_draw import draw_night
from calibration.stars.simulated.observed_night import night_solver
from calibration.stars.simulated.star_field import star_field
from calibration.stars.simulated.star_renderer import hot_pixel_map, render_stars
from calibration.stars.sky import SkyOverSite
from calibration.stars.star_angles import StarAngles
from groundstation.registration.head_registration import RegisteredAngles

NOISE_DEG, WITHHELD_DEG = 0.01, 0.5
DRIFT_PX = np.array([1.5, 0.5])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--nights", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--pictures", type=int, default=12)
    parser.add_argument("--operation", action="store_true")
    options = parser.parse_args()
    rows: dict[str, list[list[float]]] = {"noise": [], "withheld": []}
    took_s: list[float] = []
    why: dict[str, Counter[str]] = {"noise": Counter(), "withheld": Counter()}
    for seed in range(options.first, options.first + options.nights):
        night, random = draw_night(seed, options.pictures), np.random.default_rng([seed, 0x4EA])
        station, sky, solver = night.true_rig.stations[0], SkyOverSite(night.site), night_solver(night)
        head = StarAngles(station, sky, solver, 0.0, in_operation=options.operation)
        hot = hot_pixel_map(station.lens.image_size_px, random)
        for picture in night.pictures[station.name]:
            field = star_field(picture, station, solver, sky, 0.0, 0.0, random)
            image = render_stars(field, DRIFT_PX, hot, random)
            off = {
                "noise": (random.normal(0.0, NOISE_DEG, 2), NOISE_DEG),
                "withheld": (random.uniform(-WITHHELD_DEG, WITHHELD_DEG, 2), WITHHELD_DEG / np.sqrt(3.0)),
            }
            for word, (error_deg, sigma_deg) in off.items():
                pan, tilt = (picture.angles_rad + np.radians(error_deg)).tolist()
                began_s = time.thread_time()
                found = head.register_at(image, picture.utc_s, pan, tilt, float(np.radians(sigma_deg)))
                took_s.append(time.thread_time() - began_s)
                if isinstance(found, RegisteredAngles):
                    here = np.array([found.pan_rad, found.tilt_rad]) - picture.angles_rad
                    rows[word].append([*np.degrees(here), *error_deg, np.degrees(found.sigma_rad)])
                else:
                    why[word][found.value] += 1
    for word, of_word in rows.items():
        table = np.array(of_word).reshape(-1, 5)
        rms = np.sqrt(np.mean(table**2, axis=0))
        print(f"{word}: {len(table)} frames, picture {rms[0]:.5f} {rms[1]:.5f} deg", end=", ")
        print(f"encoder {rms[2]:.5f} {rms[3]:.5f}, stated {rms[4]:.5f}", end=", ")
        print(f"(error/sigma)² {np.mean((table[:, :2] / table[:, 4:]) ** 2):.2f}", end=", ")
        print(f"largest {np.abs(table[:, :2]).max():.4f}; not: {dict(why[word])}")
    print("a frame took {:.3f} s (median), 99 % within {:.3f} s".format(*np.percentile(took_s, [50, 99])))


if __name__ == "__main__":
    main()
