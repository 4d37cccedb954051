"""The program under measurement, on one driver."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


class Driver:
    """The program on one driver: as it is, or behind a command that runs it under another."""

    def __init__(self, command, program, out):
        self.command, self.program, self.out = shlex.split(command), program, out
        self.run("render", "builtin:cornell", "--size", "32x18", "--warm-up", "0")
        device = self.report()["devices"][0]
        self.full = device["driver"] if device["kind"] == "software" else f"{device['name']}, {device['driver']}"
        mesa = re.search(r"Mesa [\d.]*\d", self.full)
        self.name = mesa[0] if mesa else self.full

    def run(self, *args, out=None, caches=None):
        """Runs a command into `out`, which it empties. Drivers keep compiled pipelines in `caches`."""
        out = out or self.out
        shutil.rmtree(out, ignore_errors=True)
        return self.program_says(*args, "--quiet", "--out", out, caches=caches)

    def program_says(self, *args, caches=None):
        command = [*self.command, self.program, *map(str, args)]
        environment = os.environ | ({"MESA_SHADER_CACHE_DIR": str(caches)} if caches else {})
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, cwd=ROOT, env=environment)
        if done.returncode != 0:
            sys.exit(f"it failed: {shlex.join(command)}")
        return done.stdout

    def report(self):
        return json.loads((self.out / "run.json").read_text())
