"""Says what measurements ran on."""

import os
import platform


def processor(cores=None):
    """Model and number of cores, or of `cores` of them."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    except OSError:
        names = []
    name = names[0] if names else platform.processor() or platform.machine()
    cores = cores or os.cpu_count()
    return f"{cores} {'core' if cores == 1 else 'cores'} of {name}"
