"""What this machine is, as far as figures and bits depend on it."""

import platform
from pathlib import Path


def processor() -> str:
    """Vendor, family, model and name."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    wanted = ("vendor_id", "cpu family", "model\t", "model name")
    return "; ".join(dict.fromkeys(line.split(":", 1)[1].strip() for line in lines if line.startswith(wanted)))
