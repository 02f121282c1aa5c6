"""One HTML file with everything about a run: no script, nothing loaded from elsewhere."""

from __future__ import annotations

import base64
from html import escape
from pathlib import Path
from typing import Any, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np
from matplotlib.figure import Figure

from people_fusion.core.grids import OccupancyGrid
from people_fusion.evaluation.evaluate import Evaluation, Scores
from people_fusion.evaluation.plots import (
    plot_counts,
    plot_errors,
    plot_existence,
    plot_identities,
    plot_nees,
    plot_paths,
    plot_reported,
    plot_tracks,
    png,
)
from people_fusion.evaluation.tables import (
    Table,
    count_table,
    identity_table,
    millimetres,
    number,
    percent,
    score_table,
)
from people_fusion.evaluation.truth import Estimates, Truth

_STYLE = """
body { font: 15px/1.5 system-ui, "DejaVu Sans", sans-serif; color: #1c1e21; background: #f4f5f7; margin: 0; }
main { max-width: 1120px; margin: 0 auto; padding: 24px 28px 60px; background: white; }
h1 { font-size: 26px; margin: 8px 0 4px; } h2 { font-size: 19px; margin: 36px 0 8px; }
p.note { margin: 2px 0; color: #55595f; }
.tiles { display: flex; flex-wrap: wrap; gap: 10px; margin: 18px 0; }
.tile { flex: 1 1 112px; padding: 10px 12px; border: 1px solid #dfe2e6; border-radius: 6px; }
.tile b { display: block; font-size: 21px; white-space: nowrap; } .tile span { color: #55595f; font-size: 12.5px; }
figure { margin: 0; } figcaption { color: #55595f; } img { max-width: 100%; display: block; margin: 6px 0; }
table { border-collapse: collapse; margin: 10px 0; font-size: 14px; }
th, td { padding: 4px 14px 4px 0; text-align: right; border-bottom: 1px solid #e5e7ea; white-space: pre; }
th:first-child, td:first-child { text-align: left; }
table.words th { text-align: left; }
table.words td { text-align: left; white-space: pre-wrap; overflow-wrap: anywhere; font-family: monospace; }
.wide { overflow-x: auto; } .wide table { font-size: 12.5px; } .wide th, .wide td { padding-right: 10px; }
.columns { display: flex; flex-wrap: wrap; } .columns section { margin-right: 60px; }
"""


def write_report(path: Union[str, Path], html: str) -> None:
    """Write a report; the folder is made if need be."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(html, encoding="utf-8")


def run_report(
    title: str,
    truth: Truth,
    estimates: Estimates,
    evaluation: Evaluation,
    grid: Optional[OccupancyGrid] = None,
    settings: Optional[Mapping[str, Any]] = None,
    counters: Optional[Mapping[str, Any]] = None,
    notes: Sequence[str] = (),
) -> str:
    """HTML about one run.

    Args:
        title: of the page.
        truth, estimates, evaluation: what was evaluated, and the result.
        grid: map of the surroundings in truth's frame.
        settings: configuration of cues and tracker, nested as it may be.
        counters: events that diagnostics counted, by name.
        notes: sentences that stand below the title, e.g. which recording it was.
    """
    clear = evaluation.scores.clear_mot
    figures = [
        (
            "Tracks",
            "Where people walked (grey) and where the tracker saw them (coloured).",
            plot_tracks(truth, estimates, evaluation, grid),
        ),
        (
            "Identities",
            "Which track each person had. A perfect tracker gives one bar of one colour to each.",
            plot_identities(truth, estimates, evaluation),
        ),
        (
            "Error",
            f"Distance of each matched pair in the ground plane; their mean is MOTP, {millimetres(clear.motp_m)}.",
            plot_errors(truth, estimates, evaluation),
        ),
        ("Misses and false positives", "Per annotated frame.", plot_counts(truth, evaluation)),
        (
            "Existence",
            "Confidence of the tracker that each reported track is a person.",
            plot_existence(truth, estimates, evaluation),
        ),
        (
            "Consistency",
            "Squared error in units of the published covariance (NEES). If that is honest, 95 of 100 matched persons "
            "lie in the band and their mean is 2; above it the tracker is overconfident, below it too cautious.",
            plot_nees(truth, evaluation),
        ),
    ]
    return report(title, {title: evaluation.scores}, figures, settings, counters, notes)


def unscored_report(
    title: str,
    frames: Truth,
    estimates: Estimates,
    hits: np.ndarray,
    grid: Optional[OccupancyGrid] = None,
    settings: Optional[Mapping[str, Any]] = None,
    counters: Optional[Mapping[str, Any]] = None,
    notes: Sequence[str] = (),
) -> str:
    """HTML about a run in which nobody is annotated: what the tracker reported, not how well.

    Args:
        title: of the page.
        frames: without people; its stamps are those of the estimates.
        estimates: reported people.
        hits: (N, 2) what the scanners hit now and then, metres, in the tracks' frame.
        grid, settings, counters, notes: as in `run_report`.
    """
    figures = [
        ("Tracks", "Where the tracker saw people.", plot_paths(frames, estimates, hits, grid)),
        ("Reported people", "Nobody is annotated: how many, not how well.", plot_reported(frames, estimates)),
    ]
    tables = [("Counts", identity_table(frames, estimates))]
    return _page(title, ["Nothing is annotated, nothing is scored.", *notes], [], figures, tables, settings, counters)


def report(
    title: str,
    scores: Mapping[str, Scores],
    figures: Sequence[Tuple[str, str, Figure]],
    settings: Optional[Mapping[str, Any]] = None,
    counters: Optional[Mapping[str, Any]] = None,
    notes: Sequence[str] = (),
) -> str:
    """HTML about one or several runs.

    Args:
        title: of the page.
        scores: by name of the run; of a single one all counts are shown.
        figures: heading, caption and picture of each.
        settings, counters, notes: as in `run_report`.
    """
    if len(scores) == 1:
        (alone,) = scores.values()
        return _page(title, notes, [_tiles(alone)], figures, [("Counts", count_table(alone))], settings, counters)
    summary = ["<h2>Scores</h2>", _table(score_table(scores))]
    return _page(title, notes, summary, figures, [], settings, counters)


class Part(NamedTuple):
    """A heading, a sentence below it, and a table, a picture or both."""

    heading: str
    caption: str
    table: Optional[Table] = None
    figure: Optional[Figure] = None


def paper_report(
    title: str, parts: Sequence[Part], settings: Optional[Mapping[str, Any]] = None, notes: Sequence[str] = ()
) -> str:
    """HTML of several tables and pictures, in this order; `settings` and `notes` as in `run_report`."""
    body = []
    for part in parts:
        body.append(f'<h2>{escape(part.heading)}</h2><p class="note">{escape(part.caption)}</p>')
        if part.table is not None:
            body.append(f'<div class="wide">{_table(part.table)}</div>')
        if part.figure is not None:
            body.append(_image(part.heading, part.figure))
    return _page(title, notes, body, [], [], settings, None)


def _page(
    title: str,
    notes: Sequence[str],
    summary: Sequence[str],
    figures: Sequence[Tuple[str, str, Figure]],
    tables: Sequence[Tuple[str, Table]],
    settings: Optional[Mapping[str, Any]],
    counters: Optional[Mapping[str, Any]],
) -> str:
    parts = [f"<h1>{escape(title)}</h1>"]
    parts.extend(f'<p class="note">{escape(note)}</p>' for note in notes)
    parts.extend(summary)
    for heading, caption, figure in figures:
        parts.append(
            f"<h2>{escape(heading)}</h2><figure><figcaption>{escape(caption)}</figcaption>"
            f"{_image(heading, figure)}</figure>"
        )
    columns = [f"<h2>{escape(heading)}</h2>" + _table(table) for heading, table in tables]
    if counters:
        rows = tuple((str(name), str(value)) for name, value in counters.items())
        columns.append("<h2>Diagnostics</h2>" + _table(Table(("event", "number"), rows)))
    parts.append('<div class="columns">' + "".join(f"<section>{column}</section>" for column in columns) + "</div>")
    if settings:
        rows = tuple(_flat(settings))
        parts.append("<h2>Settings</h2>" + _table(Table(("parameter", "value"), rows), "words"))
    return _PAGE.format(title=escape(title), style=_STYLE, body="\n".join(parts))


_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:; style-src 'unsafe-inline'">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>{style}</style>
</head>
<body><main>
{body}
</main></body>
</html>
"""


def _image(name: str, figure: Figure) -> str:
    picture = base64.b64encode(png(figure)).decode("ascii")
    return f'<img alt="{escape(name)}" src="data:image/png;base64,{picture}">'


def _tiles(scores: Scores) -> str:
    clear = scores.clear_mot
    tiles = [
        (percent(clear.mota), "MOTA", "1 minus all errors over annotations"),
        (millimetres(clear.motp_m), "MOTP", "mean error of matches"),
        (percent(clear.miss_rate), "misses", "of annotations"),
        (
            "not counted" if clear.only_annotated else percent(clear.false_positive_rate),
            "false positives",
            "of annotations",
        ),
        (percent(clear.mismatch_rate), "mismatches", f"of annotations, {clear.mismatches} in number"),
        (percent(scores.identity.idf1), "IDF1", "right identity over the whole run"),
        (percent(scores.hota.hota), "HOTA", "detection and association alike"),
        (number(scores.position_consistency.average), "NEES", "2 is honest, more is overconfident"),
    ]
    entries = (
        f'<div class="tile"><b>{escape(value)}</b>{escape(name)}<br><span>{escape(meaning)}</span></div>'
        for value, name, meaning in tiles
    )
    return f'<div class="tiles">{"".join(entries)}</div>'


def _table(table: Table, style: str = "") -> str:
    def line(cells: Tuple[str, ...], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    rows: List[str] = [line(row, "td") for row in table.rows]
    return f'<table class="{style}"><thead>{line(table.header, "th")}</thead><tbody>{"".join(rows)}</tbody></table>'


def _flat(settings: Mapping[str, Any], path: str = "") -> Iterator[Tuple[str, str]]:
    """Full path and value of every parameter."""
    for key, value in settings.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{path}{key}/")
        else:
            yield f"{path}{key}", str(value)
