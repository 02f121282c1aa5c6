"""Variants of FHOG cells, and what mirrors them."""

from __future__ import annotations

import subprocess
from pathlib import Path

from people_fusion.cues.heads.fhog import FhogConfig

VARIANTS = [FhogConfig(bins=bins) for bins in range(2, 10)]
VARIANTS += [FhogConfig(bins=9, signed=False), FhogConfig(bins=9, unsigned=False)]


def mirrored(features, config):
    """Cells of the mirrored image: columns, bins and the energies of left and right change places."""
    bins, order, start = config.bins, [], 0
    if config.signed:
        order += [(bins - b) % (2 * bins) for b in range(2 * bins)]
        start = 2 * bins
    if config.unsigned:
        order += [start + (bins - b) % bins for b in range(bins)]
        start += bins
    return features[:, ::-1][:, :, [*order, start + 1, start, start + 3, start + 2]]


SOURCE = Path(__file__).resolve().parents[2] / "native/fhog.c"


def compiled(folder, *flags, source=SOURCE):
    """The folder, with the kernel in it: built as the workspace does and with further flags."""
    command = ["gcc", "-std=gnu99", "-O3", "-Wall", "-Wextra", "-Werror", "-fPIC", "-shared", *flags]
    subprocess.run([*command, "-o", str(folder / "libpeople_fusion_fhog.so"), str(source), "-lm"], check=True)
    return folder
