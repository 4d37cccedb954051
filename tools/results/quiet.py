"""Says how much of the machine other programs take."""

import os
import sys
import time
from pathlib import Path

# A run begins when other programs use less than this fraction of the cores. It gives up after this time.
QUIET, PATIENCE_S = 0.05, 600


class Meanwhile:
    """Fraction of the cores' time that other programs take from here on; None where the system does not tell."""

    def __init__(self):
        self.begin = self.now()

    @staticmethod
    def now():
        used = os.times()
        own_s = used.user + used.system + used.children_user + used.children_system
        try:
            fields = [int(field) for field in Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:9]]
        except OSError:
            return None
        user, nice, system, idle, iowait, irq, softirq, steal = (field / os.sysconf("SC_CLK_TCK") for field in fields)
        busy_s = user + nice + system + irq + softirq + steal
        return busy_s - own_s, busy_s + idle + iowait

    def others(self):
        if self.begin is None:
            return None
        (busy_s, all_s), (before_s, since_s) = self.now(), self.begin
        return max(0.0, busy_s - before_s) / max(all_s - since_s, 1e-9)


def wait_for_quiet():
    begin = time.monotonic()
    while True:
        meanwhile = Meanwhile()
        time.sleep(5)
        others = meanwhile.others()
        if others is None or others < QUIET:
            return
        if time.monotonic() - begin > PATIENCE_S:
            sys.exit(f"other programs take {others * 100:.0f} % of the cores: measure when they are done")
        print(f"waiting: other programs take {others * 100:.0f} % of the cores", file=sys.stderr, flush=True)
