"""Denoises stereo frames of Mitsuba 3 along a path of the camera, with diptych's denoiser and with OIDN.

    python denoise_mitsuba.py [--size N] [--frames N] [--spp N] [--reference-spp N]

Prints a table of errors (FLIP against a reference of the last moving frame), flicker (mean change of display values
from frame to frame while the camera stands, in 8-bit levels) and the time of the denoiser per stereo frame. Needs the
packages diptych, mitsuba and pyoidn. Mitsuba needs LLVM: DRJIT_LIBLLVM_PATH names the library.
"""

import argparse
import time

import mitsuba as mi
import numpy as np
import pyoidn

import diptych as dp

mi.set_variant("llvm_ad_rgb")

# Distance between the eyes, and the camera's step per frame, in units of the Cornell box, whose edges are 2 long.
BASELINE, STEP = 0.06, 0.01
# Frames for which the camera stands at the end of its path.
STANDING = 8
YFOV_DEG = 39.3077


class Renderer:
    """Mitsuba's Cornell box. Frames have the light, its emitted part, and features of the first surfaces."""

    NAMES = ("color", "emission", "albedo", "normal", "position")

    def __init__(self, size):
        self.size = size
        path, emitted = {"type": "path", "max_depth": 7}, {"type": "path", "max_depth": 1}
        features = {"type": "aov", "aovs": "albedo:albedo,normal:sh_normal,position:position"}
        scene = mi.cornell_box() | {"integrator": features | {"all": path, "emitted": emitted}}
        del scene["sensor"]
        self.scene = mi.load_dict(scene)

    def render(self, position, target, spp, seed):
        """Arrays of a view by name. Features of several samples are means over the pixel."""
        film = {"type": "hdrfilm", "width": self.size, "height": self.size, "rfilter": {"type": "box"}}
        film |= {"pixel_format": "rgb", "component_format": "float32"}
        to_world = mi.ScalarTransform4f().look_at(position, target, [0, 1, 0])
        sensor = {"type": "perspective", "fov": YFOV_DEG, "to_world": to_world, "film": film}
        sensor["sampler"] = {"type": "independent", "sample_count": spp}
        image = np.array(mi.render(self.scene, sensor=mi.load_dict(sensor), spp=spp, seed=seed))
        return dict(zip(self.NAMES, np.split(image, len(self.NAMES), axis=2)))


class Oidn:
    """Intel's Open Image Denoise with albedo and normals, on each view alone."""

    def __init__(self):
        self.device = pyoidn.Device()
        self.device.commit()
        self.filter = pyoidn.Filter(self.device, pyoidn.OIDN_FILTER_TYPE_RT)
        self.filter.set_bool("hdr", True)

    def denoise(self, color, albedo, normal):
        result = np.zeros_like(color)
        names = (pyoidn.OIDN_IMAGE_COLOR, pyoidn.OIDN_IMAGE_ALBEDO, pyoidn.OIDN_IMAGE_NORMAL, pyoidn.OIDN_IMAGE_OUTPUT)
        for name, image in zip(names, (color, albedo, normal, result)):
            self.filter.set_image(name, image, pyoidn.OIDN_FORMAT_FLOAT3)
        self.filter.commit()
        self.filter.execute()
        return result


def levels(image):
    """Display values, 0 to 255."""
    c = np.clip(image, 0, 1)
    return 255 * np.where(c <= 0.0031308, 12.92 * c, 1.055 * c ** (1 / 2.4) - 0.055)


def flicker(images):
    pairs = zip(images[-STANDING:], images[-STANDING + 1 :])
    return float(np.mean([np.abs(levels(a) - levels(b)).mean() for a, b in pairs]))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--size", type=int, default=256, help="width and height of each view, pixels")
    parser.add_argument("--frames", type=int, default=16, help="frames in which the camera moves")
    parser.add_argument("--spp", type=int, default=1)
    parser.add_argument("--reference-spp", type=int, default=1024)
    options = parser.parse_args()
    size = (options.size, options.size)
    renderer, oidn = Renderer(options.size), Oidn()
    denoiser = dp.Denoiser(size, views=2, spp=options.spp)

    def eyes(index):
        x = STEP * min(index, options.frames - 1)
        return [((x + side * BASELINE / 2, 0, 3.9), (x + side * BASELINE / 2, 0, 0)) for side in (-1, 1)]

    images, times_ms = {"noisy": [], "dp.Denoiser": [], "OIDN": []}, {"dp.Denoiser": [], "OIDN": []}
    for index in range(options.frames + STANDING):
        views = [renderer.render(*eye, options.spp, 2 * index + i) for i, eye in enumerate(eyes(index))]
        arrays = {name: np.stack([view[name] for view in views]) for name in renderer.NAMES}
        cameras = [dp.Camera.look_at(*eye, yfov_deg=YFOV_DEG, size=size) for eye in eyes(index)]
        begin = time.perf_counter()
        images["dp.Denoiser"].append(denoiser.denoise(**arrays, camera=cameras))
        between = time.perf_counter()
        features = zip(arrays["color"], arrays["albedo"], arrays["normal"])
        images["OIDN"].append(np.stack([oidn.denoise(*map(np.ascontiguousarray, view)) for view in features]))
        times_ms["dp.Denoiser"].append(1e3 * (between - begin))
        times_ms["OIDN"].append(1e3 * (time.perf_counter() - between))
        images["noisy"].append(arrays["color"])
    last = options.frames - 1
    reference = [
        np.mean([renderer.render(*eye, 64, 1000 + i)["color"] for i in range(options.reference_spp // 64)], axis=0)
        for eye in eyes(last)
    ]
    print("| | FLIP | flicker | ms |\n| --- | --- | --- | --- |")
    for name, frames in images.items():
        last_flip = np.mean([dp.compare(a, b).flip for a, b in zip(frames[last], reference)])
        still = f"{flicker(frames):.2f}"
        ms = f"{np.median(times_ms[name][2:]):.0f}" if name in times_ms else ""
        print(f"| {name} | {last_flip:.3f} | {still} | {ms} |")


if __name__ == "__main__":
    main()
