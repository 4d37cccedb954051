"""Measures what GPU compilers make of the kernels, without a GPU, and compares with docs/results/results.json.

Mesa's drivers for AMD (RADV, with the compiler ACO) and NVIDIA (NVK, with NAK) compile every kernel, on the device of
mesa-drm-shim, which executes nothing. Pictures and counts of these runs are garbage, and diptych refuses the frame.

DIPTYCH_NAME_PIPELINES=1 has diptych name each pipeline before and after its compilation, so the statistics that a
driver prints in between belong to this kernel.
"""

import argparse
import collections
import json
import pathlib
import re
import shlex
import subprocess
import sys
import tempfile

sys.path.append(str(pathlib.Path(__file__).parents[1] / "results"))

from text import json_text

SCENES = ["cornell", "atrium", "gallery", "studio"]
# The driver's file, the library of mesa-drm-shim, and the environment that selects the chip and prints statistics.
AMD = {"MESA_SHADER_CACHE_DISABLE": "true", "RADV_DEBUG": "shaderstats,nocache"}
NVIDIA = {"MESA_SHADER_CACHE_DISABLE": "true", "NAK_DEBUG": "print", "NVK_I_WANT_A_BROKEN_VULKAN_DRIVER": "1"}
CHIPS = {
    "navi21": ("radeon", "amdgpu", {**AMD, "AMDGPU_GPU_ID": "navi21"}, ["hardware", "compute"]),
    "navi31": ("radeon", "amdgpu", {**AMD, "AMDGPU_GPU_ID": "navi31"}, ["hardware", "compute"]),
    "ampere": ("nouveau", "nouveau", {**NVIDIA, "NOUVEAU_CHIPSET": "172"}, ["compute"]),
}
# Vector registers of a SIMD for each of 32 lanes, and the number of them that is allocated at a time to 32 lanes.
REGISTERS = {"navi21": (1024, 16), "navi31": (1536, 24)}
WAVES_PER_SIMD = 16
LDS_BYTES = 64 << 10  # of a compute unit
SIMDS = 2  # of a compute unit

SHIM = "lib{}_noop_drm_shim.so"
MESA = 25

FIGURES = ["registers", "live", "spilled", "scratch", "lds", "waves", "code"]
TITLES = ["registers", "live", "spilled", "scratch, bytes", "LDS, bytes", "waves per SIMD", "code, bytes"]
# Names of the same figures in the drivers' output. What RADV calls spilled is in registers.
RADV = ["VGPRs", "Pre-Sched VGPRs", "Spilled VGPRs", "Scratch size", "LDS size", None, "Code size"]
NAK = ["Num GPRs", None, None, "SLM size", None, None, None]

BEGIN = re.compile(r"pipeline (\S+) of (\d+) invocations, ray queries: (true|false)")
FIGURE = re.compile(r"([A-Z][A-Za-z -]*): (\d+)\s*$")


def waves(chip, figures, invocations, traces):
    """Waves that a SIMD holds at once, by registers and by LDS. RADV 25 runs kernels with ray queries and those of small
    workgroups in waves of 32 lanes and others in waves of 64, of which a SIMD holds half as many in the same registers."""
    lanes = 32 if traces or invocations <= 32 else 64
    total, grain = (number * 32 // lanes for number in REGISTERS[chip])
    registers = -(-max(figures["registers"], 1) // grain) * grain
    by_registers = min(total // registers, WAVES_PER_SIMD)
    if not figures["lds"]:
        return by_registers
    groups = LDS_BYTES // figures["lds"]
    return min(by_registers, groups * max(invocations // lanes, 1) / SIMDS)


def kernels(chip, lines):
    """Figures by kernel from the output of a run."""
    names = NAK if chip == "ampere" else RADV
    found, current = {}, None
    for line in lines:
        if match := BEGIN.match(line):
            current = {"of": match, "figures": {}}
        elif line.startswith("end of pipeline ") and current:
            figures = current["figures"]
            if figures:
                _, invocations, traces = current["of"].groups()
                if chip in REGISTERS:
                    figures["waves"] = waves(chip, figures, int(invocations), traces == "true")
                # A kernel may have a pipeline for jittered frames and one for others. The greater one counts.
                before = found.get(current["of"][1])
                if not before or before.get("code", 0) < figures.get("code", 0):
                    found[current["of"][1]] = figures
            current = None
        elif current and (match := FIGURE.match(line)) and match[1] in names:
            current["figures"][FIGURES[names.index(match[1])]] = int(match[2])
    return found


def remembered(lines, last):
    for line in lines:
        last.append(line)
        yield line


def run(options, chip, scene, traversal):
    """Kernels of a scene's default settings on a chip."""
    driver, shim, environment, _ = CHIPS[chip]
    icd = f"/usr/share/vulkan/icd.d/{driver}_icd.json"
    environment = {
        **environment, "LD_PRELOAD": SHIM.format(shim), "VK_DRIVER_FILES": icd, "VK_ICD_FILENAMES": icd,
        "DIPTYCH_NAME_PIPELINES": "1",
    }
    with tempfile.TemporaryDirectory(dir=options.out) as folder:
        command = [*options.under, "env", *(f"{name}={value}" for name, value in environment.items())]
        command += [options.diptych, "render", f"builtin:{scene}", "--size", "64x64", "--frames", "1", "--warm-up", "0"]
        command += ["--set", f"traversal={traversal}", "--quiet", "--out", folder]
        # The output of NAK is long, so only the last lines of it stay in memory.
        pipe = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True, "errors": "replace"}
        with subprocess.Popen(command, **pipe) as process:
            last = collections.deque(maxlen=5)
            found = kernels(chip, remembered(process.stdout, last))
    if not found:
        sys.exit(f"{chip}, {scene}, {traversal}: no kernel was compiled: {''.join(last)}")
    return found


def text_of(figures):
    return " ".join(f"{figures[name]:g}" if name in figures else "-" for name in FIGURES)


def figures_of(text):
    return {name: float(value) for name, value in zip(FIGURES, text.split()) if value != "-"}


def is_worse(name, before, now):
    """Whether a figure is worse by more than 5 %. More waves are better, and less of anything else."""
    return now < before / 1.05 if name == "waves" else now > before * 1.05


def regressions(before, now):
    found = []
    for place, kernels in now.items():
        for kernel, text in kernels.items():
            old = figures_of(before.get(place, {}).get(kernel, ""))
            new = figures_of(text)
            worse = [name for name in FIGURES if name in old and name in new and is_worse(name, old[name], new[name])]
            found += [f"{place}, {kernel}: {name} {old[name]:g} -> {new[name]:g}" for name in worse]
    return found


def table(measured):
    """Kernels that trace rays, as Markdown."""
    text = f"| | kernel | {' | '.join(TITLES)} |\n" + "| --- " * (len(TITLES) + 2) + "|\n"
    for place, kernels in measured.items():
        for kernel in ("gbuffer", "path_trace", "gradient"):
            if kernel in kernels:
                text += f"| {place} | {kernel} | {kernels[kernel].replace('-', '–').replace(' ', ' | ')} |\n"
    return text


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--diptych", default="target/release/diptych")
    parser.add_argument("--under", type=shlex.split, default=[], help="command that runs another under Mesa 25")
    parser.add_argument("--results", type=pathlib.Path, default="docs/results/results.json")
    parser.add_argument("--out", default="out", help="folder for temporary files")
    parser.add_argument("--scenes", nargs="*", default=SCENES)
    parser.add_argument("--chips", nargs="*", default=list(CHIPS))
    parser.add_argument("--accept", action="store_true", help="write the figures even if some are worse")
    options = parser.parse_args()
    mesa = mesa_version(options)
    if not mesa:
        print(f"gpu-kernels: skipped, since Debian's Mesa {MESA} with the package mesa-drm-shim is not there.")
        print("NEWER_MESA=COMMAND names a command that runs another one in a system that has them.")
        return
    measured = {}
    for chip in options.chips:
        for traversal in CHIPS[chip][3]:
            for scene in options.scenes:
                found = run(options, chip, scene, traversal)
                measured[f"{chip}, {scene}, {traversal}"] = {name: text_of(found[name]) for name in sorted(found)}
                print(f"{chip}, {scene}, {traversal}: {len(found)} kernels", flush=True)
    print(f"\n{table(measured)}")
    results = json.loads(options.results.read_text())
    before = results.get("kernels", {}).get("measured", {})
    worse = regressions(before, measured)
    print("\n".join(worse))
    if worse and not options.accept:
        sys.exit(f"{len(worse)} figures are worse by more than 5 %. ARGS=--accept writes them nevertheless")
    results["kernels"] = {"driver": mesa, "figures": FIGURES, "measured": {**before, **measured}}
    options.results.write_text(json_text(results))


def mesa_version(options):
    """Mesa's version, such as "Mesa 25.0.7-2", if it is the one that the figures are for and the shim is there."""
    packages = ["mesa-vulkan-drivers", "mesa-drm-shim"]
    command = [*options.under, "dpkg-query", "--show", "--showformat", "${Version}\\n", *packages]
    try:
        done = subprocess.run(command, capture_output=True, text=True)
    except FileNotFoundError:
        return None
    versions = done.stdout.split()
    known = done.returncode == 0 and len(versions) == len(packages) and versions[0].startswith(f"{MESA}.")
    return f"Mesa {versions[0]}" if known else None


if __name__ == "__main__":
    main()
