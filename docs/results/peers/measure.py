"""Time against error of diptych and of Mitsuba 3 with Intel's OIDN, measured in one run on this machine.

    measure.py [options] SHOT...

A shot is what `diptych render` takes. Both sides render the same scene, as `diptych export` writes it, from the same eyes
at the same instant, with as many bounces, on the same cores, in turns. Both are judged by NVIDIA's FLIP against the same
reference, Mitsuba's, after the same tonemapping at the shot's exposure; errors are means over both eyes. diptych renders
each setting twice: the last frame of a path, with the history of those before, and the same frame as the first of a path,
without history. With --history, Mitsuba has one, too, at few samples: its last frames, reprojected by its own positions
(history.py) before OIDN filters them; the time of reprojection counts. Times are those of a stereo frame: with history, medians over the frames on the way to that instant;
otherwise medians over the rounds. None of them includes loading, compiling or files. Writes NAME.md, tables, NAME.json,
the same figures for programs, NAME.svg, a chart, and NAME.toml for `diptych bench --set peers`. With several --diptych,
which may be one program under several drivers, all of them take turns; the files of the second are NAME-2.md and so on.
"""

import argparse
import hashlib
import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

# Frames that diptych is given on its way to the instant that is compared, and of them those that are cold.
FRAMES, COLD, FPS = 16, 4, 72
INSTANT = (FRAMES - 1) / FPS

PEER_SAMPLES = (1, 4, 16)
# A history takes all frames of a path.
HISTORY_SAMPLES = (1, 4)
PEER, FAST, GUIDED = "Mitsuba", "Mitsuba + OIDN, fast", "Mitsuba + OIDN, high, albedo and normals"
FAST_HISTORY, GUIDED_HISTORY = (f"{name}, {FRAMES} frames of history" for name in (FAST, GUIDED))

# Settings of diptych: name, options, and True if the first frame of a path is measured beside the last.
OURS = (
    ("1 spp, render scale 0.5", ("--spp", "1", "--set", "render_scale=0.5"), False),
    *((f"{spp} spp", ("--spp", str(spp)), True) for spp in (1, 2, 4, 8)),
    ("4 spp, not denoised", ("--spp", "4", "--denoiser", "none", "--reproject", "off"), False),
)
FIRST_FRAME, NOT_DENOISED = ", first frame", ", not denoised"
WITH_HISTORY, WITHOUT_HISTORY = f"{FRAMES}th frame of a path, with history", "first frame, no history"

# Samples of a reference that are taken at a time; more take more memory.
PASS = 64


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("shots", nargs="*", metavar="SHOT", help="builtin:NAME, a .toml or a .gltf/.glb")
    parser.add_argument("--diptych", action="append", help="the program, perhaps behind another one")
    parser.add_argument("--out", type=Path, default=Path("out/peers"))
    parser.add_argument("--size", default="320x180", help="of each eye")
    parser.add_argument("--bounces", type=int, default=6)
    parser.add_argument("--rounds", type=int, default=3, help="turns that both sides take")
    parser.add_argument("--reference-spp", type=int, default=4096)
    parser.add_argument(
        "--own-reference", action="store_true", help="judge diptych by its own reference, where materials differ"
    )
    parser.add_argument("--history", action="store_true", help="also measure Mitsuba with a history")
    parser.add_argument("--cores", type=int, help="use so many cores only (Linux)")
    options = parser.parse_args()
    options.width, options.height = map(int, options.size.split("x"))
    options.diptych = options.diptych or ["target/release/diptych"]
    return options


options = arguments()
# Times of a machine that others use are of little use.
LOAD = os.getloadavg()[0]
if options.cores:
    # Before anything starts threads, who count the cores that they may use.
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: options.cores])


def find_llvm():
    """Mitsuba compiles with LLVM, and asks for a newer one than older systems have."""
    for library in sorted(Path(sys.prefix, "lib").glob("libLLVM.so.*"))[-1:]:
        os.environ.setdefault("DRJIT_LIBLLVM_PATH", str(library))


find_llvm()

import flip_evaluator  # noqa: E402
import mitsuba as mi  # noqa: E402
import numpy as np  # noqa: E402
import pyoidn as oidn  # noqa: E402

mi.set_variant("llvm_ad_rgb")

import drjit  # noqa: E402
from chart import chart  # noqa: E402
from history import Camera, History  # noqa: E402
from machine import processor  # noqa: E402
from mitsuba_scene import Shot  # noqa: E402


def say(text):
    print(text, file=sys.stderr, flush=True)


def median(values):
    return float(np.median(values))


def diptych(program, *args):
    command = [*shlex.split(program), *map(str, args)]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True)
    if done.returncode != 0:
        sys.exit(f"it failed: {shlex.join(command)}")
    return done.stdout


def flip(reference, images, exposure_ev):
    """The mean over both eyes of FLIP, of what is shown of linear radiance at that exposure."""

    def shown(image):
        c = np.maximum(np.nan_to_num(image, posinf=1e30), 0) * 2.0**exposure_ev
        c = c / (1 + c)
        return np.where(c <= 0.0031308, 12.92 * c, 1.055 * np.maximum(c, 1e-9) ** (1 / 2.4) - 0.055).astype(np.float32)

    errors = [flip_evaluator.evaluate(shown(r), shown(i), "LDR")[1] for r, i in zip(reference, images)]
    return float(np.mean(errors))


class Mitsuba:
    """A shot's scene, and a second integrator that also tells what OIDN is guided by."""

    def __init__(self, shot):
        self.shot = shot
        self.scene = shot.load(INSTANT, options.width, options.height, options.bounces)
        self.plain = self.scene.integrator()
        self.guided = self.with_images("albedo:albedo,normal:sh_normal")
        self.placed = self.with_images("albedo:albedo,normal:sh_normal,position:position")

    def with_images(self, names):
        return mi.load_dict({"type": "aov", "aovs": names, "path": self.shot.integrator(options.bounces)})

    def frame(self, spp, seed, guided=False):
        """Both eyes, and the seconds that they took."""
        begin = time.perf_counter()
        eyes = []
        for eye in range(2):
            integrator = self.guided if guided else self.plain
            image = mi.render(self.scene, sensor=eye, integrator=integrator, spp=spp, seed=2 * seed + eye)
            eyes.append(np.array(image))
        return eyes, time.perf_counter() - begin

    def path(self, spp, seed):
        """Both eyes of the last frame of the path with the history of those before, and the seconds that it took."""
        histories, fov = [History(), History()], self.shot.shot["rig"]["yfov_deg"]
        for number in range(FRAMES):
            time_s = number / FPS
            sensors = [mi.load_dict(c) for c in self.shot.cameras(time_s, options.width, options.height).values()]
            cameras = [Camera(*eye, fov) for eye in self.shot.eyes(time_s)]
            begin, eyes = time.perf_counter(), []
            for eye, (sensor, camera, history) in enumerate(zip(sensors, cameras, histories)):
                seeds = 2 * (seed * FRAMES + number) + eye
                image = np.array(mi.render(self.scene, sensor=sensor, integrator=self.placed, spp=spp, seed=seeds))
                color, albedo, normal, position = (image[..., 3 * i : 3 * i + 3] for i in range(4))
                eyes.append(np.dstack([history.add(camera, color, albedo, normal, position), albedo, normal]))
        return eyes, time.perf_counter() - begin

    def reference(self, spp):
        sums, passes = [0.0, 0.0], max(1, spp // PASS)
        for number in range(passes):
            eyes, _ = self.frame(min(spp, PASS), seed=1_000_000 + number)
            sums = [total + eye.astype(np.float64) for total, eye in zip(sums, eyes)]
        return [(total / passes).astype(np.float32) for total in sums]


class Oidn:
    """OIDN's filter, made once: at its highest quality and `guided` by albedo and normals, or fast and by colour alone."""

    def __init__(self, device, guided):
        names = (oidn.OIDN_IMAGE_COLOR, oidn.OIDN_IMAGE_ALBEDO, oidn.OIDN_IMAGE_NORMAL)[: 3 if guided else 1]
        blank = np.zeros((options.height, options.width, 3), np.float32)
        self.inputs, self.output = [blank.copy() for _ in names], blank
        self.filter = oidn.Filter(device, oidn.OIDN_FILTER_TYPE_RT)
        for name, image in zip(names, self.inputs):
            self.filter.set_image(name, image, oidn.OIDN_FORMAT_FLOAT3)
        self.filter.set_image(oidn.OIDN_IMAGE_OUTPUT, self.output, oidn.OIDN_FORMAT_FLOAT3)
        self.filter.set_bool("hdr", True)
        self.filter.set_int("quality", oidn.OIDN_QUALITY_HIGH if guided else oidn.OIDN_QUALITY_FAST)
        self.filter.commit()

    def frame(self, eyes):
        """Both eyes, whose channels are colour, albedo and normal, and the seconds that they took."""
        filtered, begin = [], time.perf_counter()
        for eye in eyes:
            for number, image in enumerate(self.inputs):
                image[:] = eye[..., 3 * number : 3 * number + 3]
            self.filter.execute()
            filtered.append(self.output.copy())
        return filtered, time.perf_counter() - begin


class Diptych:
    """The program on a shot's files."""

    def __init__(self, program, shot, folder):
        self.program, self.shot, self.folder, self.driver, self.exposure_ev = program, shot, folder, "", 0.0

    def frame(self, settings, seed, path):
        """Both eyes of the last frame of `path`, and the milliseconds of each of its frames."""
        fixed = ("--size", options.size, "--bounces", options.bounces, "--seed", seed, "--quiet", "--out", self.folder)
        diptych(self.program, "render", self.shot, *path, *settings, *fixed)
        report = json.loads((self.folder / "run.json").read_text())
        device = report["devices"][0]
        self.driver = f"{device['name']}, {device['driver']}"
        self.exposure_ev = report["settings"]["exposure_ev"]
        files = [max(self.folder.glob(f"{eye}*.exr")) for eye in ("left", "right")]
        eyes = [np.array(mi.Bitmap(str(file)))[..., :3] for file in files]
        for file in self.folder.glob("*.exr"):
            file.unlink()
        return eyes, [frame["makespan_ms"] for frame in report["frames"]]


    def reference(self, spp):
        at = ("--time", INSTANT, "--reference", "--spp", spp)
        eyes, _ = self.frame((), 1_000_000, at)
        return eyes


class Figures:
    """Milliseconds and FLIP of what has been measured, by renderer and setting."""

    def __init__(self, references, exposure_ev):
        """`references` has the one of "diptych" and that of the others, under None."""
        self.references, self.exposure_ev, self.times, self.errors = references, exposure_ev, {}, {}

    @staticmethod
    def shared(all_figures):
        """A function that adds one measurement to all of them."""
        return lambda *measured: [figures.add(*measured) for figures in all_figures]

    def add(self, name, note, eyes, times_ms):
        reference = self.references.get(name, self.references[None])
        self.times.setdefault((name, note), []).extend(times_ms)
        self.errors.setdefault((name, note), []).append(flip(reference, eyes, self.exposure_ev))

    def rows(self):
        """Median, least and most milliseconds and FLIP of each, in the order of measuring."""
        for (name, note), times in self.times.items():
            ms = {"ms": median(times), "least_ms": min(times), "most_ms": max(times)}
            yield {"renderer": name, "setting": note, **ms, "flip": float(np.mean(self.errors[name, note]))}


def measure_peer(mitsuba, filters, add, seed, history):
    for spp in PEER_SAMPLES:
        note = f"{spp} spp"
        eyes, took = mitsuba.frame(spp, seed)
        add(PEER, note, eyes, [1e3 * took])
        filtered, filtering = filters[FAST].frame(eyes)
        add(FAST, note, filtered, [1e3 * (took + filtering)])
        eyes, took = mitsuba.frame(spp, seed, guided=True)
        filtered, filtering = filters[GUIDED].frame(eyes)
        add(GUIDED, note, filtered, [1e3 * (took + filtering)])
        if history and spp in HISTORY_SAMPLES:
            eyes, took = mitsuba.path(spp, seed)
            for name, peer in ((FAST_HISTORY, FAST), (GUIDED_HISTORY, GUIDED)):
                filtered, filtering = filters[peer].frame(eyes)
                add(name, note, filtered, [1e3 * (took + filtering)])


def measure_ours(ours, figures, seed):
    along = ("--frames", FRAMES, "--fps", FPS)
    for note, settings, with_first in OURS:
        eyes, times = ours.frame(settings, seed, along)
        figures.add("diptych", note, eyes, times[COLD:])
        if with_first:
            eyes, times = ours.frame(settings, seed, ("--time", INSTANT, "--warm-up", 0))
            figures.add("diptych", note + FIRST_FRAME, eyes, times)


def reference_of(renderer, version, files, folder):
    """Renders the reference, or reads it where `folder` has it from an earlier run."""
    settings = (options.size, options.bounces, options.reference_spp, INSTANT, type(renderer).__name__, version)
    key = hashlib.sha256(repr(settings).encode())
    for file in files:
        key.update(file.read_bytes())
    kept = folder / f"reference-{key.hexdigest()[:16]}.npy"
    if not kept.exists():
        say(f"reference by {type(renderer).__name__}, {options.reference_spp} samples per pixel")
        np.save(kept, renderer.reference(options.reference_spp))
    return np.load(kept)


def conditions(shot, ours):
    llvm = Path(os.environ.get("DRJIT_LIBLLVM_PATH", "its own")).resolve().name
    judged = f"against Mitsuba's {options.reference_spp} samples per pixel"
    if options.own_reference:
        judged = f"of each renderer against its own reference of {options.reference_spp} samples per pixel"
    lines = [
        f"{processor(options.cores)}; diptych on {ours.driver}; Mitsuba {mi.__version__} with {llvm}; load {LOAD:.1f} before it.",
        f"{options.size} per eye, {options.bounces} bounces, {options.rounds} rounds in turns. Times are of a stereo frame.",
        f"FLIP is the mean of both eyes at {ours.exposure_ev:g} EV, {judged}.",
        f"diptych's frames are the last of {FRAMES} along the camera's path, with history, and first frames of a path, which "
        "have no history, as Mitsuba's have none.",
    ]
    if options.history:
        lines[-1] += f" With history, Mitsuba's last {FRAMES} frames are averaged before OIDN; NumPy reprojects them."
    if shot.departures:
        lines.append("Mitsuba's scene departs from the file's: " + "; ".join(sorted(shot.departures)) + ".")
    return lines


def table(headers, rows):
    lines = [headers, ["---"] * len(headers), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def beside(rows):
    """Each of OIDN's figures, with what diptych takes to reach its FLIP with and without history: None if nothing does."""
    ours = [row for row in rows if row["renderer"] == "diptych" and not row["setting"].endswith(NOT_DENOISED)]

    def reaching(error, first):
        able = [row for row in ours if row["flip"] <= error and row["setting"].endswith(FIRST_FRAME) == first]
        best = min(able, key=lambda row: row["ms"], default=None)
        return best and {"setting": best["setting"].removesuffix(FIRST_FRAME), "ms": best["ms"]}

    return [
        row | {"with_history": reaching(row["flip"], False), "without_history": reaching(row["flip"], True)}
        for row in rows
        if row["renderer"] in (FAST, GUIDED, FAST_HISTORY, GUIDED_HISTORY)
    ]


def markdown(shot, rows, lines):
    def cells(row, reached):
        if reached is None:
            return ["none", "-"]
        return [f"{reached['ms']:.0f} ms ({reached['setting']})", f"{row['ms'] / reached['ms']:.1f}"]

    compared = [
        [f"{row['flip']:.3f}", row["renderer"], f"{row['ms']:.0f} ms ({row['setting']})"]
        + cells(row, row["with_history"])
        + cells(row, row["without_history"])
        for row in beside(rows)
    ]
    measured = [
        [r["renderer"], r["setting"], f"{r['ms']:.0f}", f"{r['least_ms']:.0f} to {r['most_ms']:.0f}", f"{r['flip']:.3f}"]
        for r in rows
    ]
    ours = [f"diptych, {WITH_HISTORY}", "times as fast", f"diptych, {WITHOUT_HISTORY}", "times as fast"]
    return (
        f"## {shot.name}\n\n"
        + table(["FLIP to reach", "of", "takes it", *ours], compared)
        + "\n"
        + table(["renderer", "setting", "ms", "least to most", "FLIP"], measured)
        + "\n"
        + "\n".join(lines)
        + "\n"
    )


def peers_file(figures, lines):
    """For `diptych bench --set peers`."""
    text = "".join(f"# {line}\n" for line in lines) + f"\nexposure_ev = {figures.exposure_ev}\n"
    for row in figures.rows():
        if row["renderer"] != "diptych":
            text += f'\n[[peer]]\nname = "{row["renderer"]}"\ntime_ms = {row["ms"]:.1f}\n'
            text += f'flip = {row["flip"]:.4f}\nnote = "{row["setting"]}"\n'
    return text


def compare(argument, device):
    with tempfile.TemporaryDirectory() as scratch:
        exported = Path(diptych(options.diptych[0], "export", argument, "--out", Path(scratch) / "shot").strip())
        shot = Shot(exported, scratch)
        folder = options.out / exported.stem
        folder.mkdir(parents=True, exist_ok=True)
        mitsuba = Mitsuba(shot)
        filters = {FAST: Oidn(device, guided=False), GUIDED: Oidn(device, guided=True)}
        all_ours = [Diptych(program, exported, Path(scratch) / "out") for program in options.diptych]
        files = sorted(exported.parent.iterdir())
        references = {None: reference_of(mitsuba, mi.__version__, files, folder)}
        if options.own_reference:
            version = hashlib.sha256(Path(shutil.which(shlex.split(options.diptych[0])[-1])).read_bytes()).hexdigest()
            references["diptych"] = reference_of(all_ours[0], version, files, folder)
        say(f"{shot.name}: warming up")
        for ours in all_ours:
            ours.frame((), options.rounds, ())
        all_figures = [Figures(references, ours.exposure_ev) for ours in all_ours]
        measure_peer(mitsuba, filters, lambda *_: None, options.rounds, history=False)
        for number in range(options.rounds):
            say(f"{shot.name}: round {number + 1} of {options.rounds}")
            measure_peer(mitsuba, filters, Figures.shared(all_figures), number, options.history)
            for ours, figures in zip(all_ours, all_figures):
                measure_ours(ours, figures, seed=number)
    for number, (ours, figures) in enumerate(zip(all_ours, all_figures), 1):
        write(folder, exported.stem + (f"-{number}" if number > 1 else ""), shot, ours, figures)


def write(folder, name, shot, ours, figures):
    lines = conditions(shot, ours)
    rows = list(figures.rows())
    text = markdown(shot, rows, lines)
    (folder / f"{name}.md").write_text(text)
    programs = {"driver": ours.driver, "conditions": lines, "rows": rows, "beside": beside(rows)}
    (folder / f"{name}.json").write_text(json.dumps(programs, indent=2) + "\n")
    (folder / f"{name}.toml").write_text(peers_file(figures, lines))
    title = f"{shot.name}, {options.size}: error against time; beside points, samples per pixel"
    (folder / f"{name}.svg").write_text(chart(title, text))
    print(text, flush=True)
    say(f"written: {folder / name}.md")


def main():
    if options.cores:
        # With one thread, Mitsuba waits for ever where it reads EXRs.
        drjit.set_thread_count(max(2, options.cores))
    with oidn.Device() as device:
        device.commit()
        for shot in options.shots or ["builtin:cornell", "builtin:atrium"]:
            compare(shot, device)


main()
