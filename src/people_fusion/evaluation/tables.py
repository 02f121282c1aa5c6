"""Scores as plain text and as Markdown, in the columns of Poschmann's table 7.1 and those that came after it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import List, Mapping, Optional, Tuple

import numpy as np

from people_fusion.core.stamps import to_seconds
from people_fusion.evaluation.clear_mot import ratio
from people_fusion.evaluation.evaluate import Scores
from people_fusion.evaluation.truth import Estimates, Truth

UNDEFINED = "–"


@dataclass(frozen=True)
class Table:
    """Words in rows and columns; the first column is set flush left, the others flush right.

    Attributes:
        header: one title a column.
        rows: as many cells each.
    """

    header: Tuple[str, ...]
    rows: Tuple[Tuple[str, ...], ...]

    def as_text(self) -> str:
        """Aligned for a terminal, without a newline at the end."""
        lines = [self.header, *self.rows]
        widths = [max(len(line[column]) for line in lines) for column in range(len(self.header))]
        aligned = ["  ".join(_aligned(line, widths)).rstrip() for line in lines]
        return "\n".join([aligned[0], "  ".join("-" * width for width in widths), *aligned[1:]])

    def as_markdown(self) -> str:
        """Aligned too, so that it can be read as it is."""
        lines = [tuple(cell.replace("|", "\\|") for cell in line) for line in (self.header, *self.rows)]
        widths = [max(3, *(len(line[column]) for line in lines)) for column in range(len(self.header))]
        rule = ["-" * widths[0], *("-" * (width - 1) + ":" for width in widths[1:])]
        cells = [_aligned(line, widths) for line in lines]
        return "\n".join("| " + " | ".join(line) + " |" for line in [cells[0], rule, *cells[1:]])


def score_table(scores: Mapping[str, Scores]) -> Table:
    """One row for each named run or sum of runs."""
    header = ("", "MOTP", "MOTA", "misses", "false pos.", "mismatches", "IDF1", "HOTA", "NEES")
    return Table(header, tuple((name, *_cells(entry)) for name, entry in scores.items()))


def count_table(scores: Scores) -> Table:
    """What the rates of one run are made of."""
    clear, identity, hota = scores.clear_mot, scores.identity, scores.hota
    positions, states = scores.position_consistency, scores.state_consistency
    rows = (
        ("annotated frames", str(clear.frames)),
        ("annotations", str(clear.ground_truth_count)),
        ("matches", str(clear.matches)),
        ("misses", str(clear.misses)),
        ("false positives", "not counted" if clear.only_annotated else str(clear.false_positives)),
        ("mismatches", str(clear.mismatches)),
        ("  by a track that had another person", str(clear.takeovers)),
        ("  by a track that had nobody else", str(clear.mismatches - clear.takeovers)),
        ("transfers (not in MOTA)", str(clear.transfers)),
        ("recall", percent(clear.recall)),
        ("precision", percent(clear.precision)),
        ("IDP / IDR", f"{percent(identity.idp)} / {percent(identity.idr)}"),
        ("DetA / AssA", f"{percent(hota.detection_accuracy)} / {percent(hota.association_accuracy)}"),
        ("LocA", percent(hota.localisation_accuracy)),
        ("NEES of position (2 is honest)", number(positions.average)),
        ("  of these within 95 % band", percent(positions.inside_share)),
        ("NEES with velocity (4 is honest)", number(states.average)),
        ("  of these within 95 % band", percent(states.inside_share)),
    )
    return Table(("count", "value"), rows)


def identity_table(frames: Truth, estimates: Estimates) -> Table:
    """What a tracker reported in some frames, where nobody is annotated."""
    stamps_ns = frames.stamps_ns[estimates.frames]
    lives_s = [to_seconds(int(np.ptp(stamps_ns[estimates.ids == track]))) for track in np.unique(estimates.ids)]
    rows = (
        ("frames", str(frames.frame_count)),
        ("reported people, mean of a frame", number(ratio(len(estimates.ids), frames.frame_count))),
        ("identities", str(len(lives_s))),
        ("longest identity", f"{max(lives_s, default=0.0):.1f} s"),
    )
    return Table(("count", "value"), rows)


def percent(share: Optional[float]) -> str:
    """Share of 1 in percent."""
    return UNDEFINED if share is None else f"{100.0 * share:.1f} %"


def millimetres(distance_m: Optional[float]) -> str:
    """Metres in millimetres."""
    return UNDEFINED if distance_m is None else f"{1000.0 * distance_m:.0f} mm"


def number(value: Optional[float]) -> str:
    """Two decimals."""
    return UNDEFINED if value is None else f"{value:.2f}"


def _cells(scores: Scores) -> Tuple[str, ...]:
    clear = scores.clear_mot
    return (
        number(clear.motp_image) if clear.in_image else millimetres(clear.motp_m),
        percent(clear.mota),
        percent(clear.miss_rate),
        UNDEFINED if clear.only_annotated else percent(clear.false_positive_rate),
        percent(clear.mismatch_rate),
        percent(scores.identity.idf1),
        percent(scores.hota.hota),
        number(scores.position_consistency.average),
    )


def _aligned(cells: Tuple[str, ...], widths: List[int]) -> List[str]:
    return [cells[0].ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(cells[1:], widths[1:]))]
