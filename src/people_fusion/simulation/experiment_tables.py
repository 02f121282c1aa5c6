"""What came of experiments, as tables with the thesis's figures beside ours, and as pictures."""

from __future__ import annotations

from typing import Any, List, Mapping, Sequence, Tuple

import numpy as np
from matplotlib.figure import Figure

from people_fusion.evaluation.experiment_plots import Panel, plot_cost, plot_rows
from people_fusion.evaluation.tables import UNDEFINED, Table
from people_fusion.simulation.experiments import COLUMNS, VARIANT, Column, TableConfig

Results = Mapping[str, Sequence[Mapping[str, Any]]]  # figures of each seed, by configuration


def spread(results: Results, configuration: str, figure: str) -> Tuple[float, float]:
    """Mean and standard deviation (of a sample) over the seeds; NaN where there are too few."""
    known = [each[figure] for each in results.get(configuration, ()) if each[figure] is not None]
    mean = float(np.mean(known)) if known else float("nan")
    return mean, float(np.std(known, ddof=1)) if len(known) > 1 else float("nan")


def table_of(table: TableConfig, results: Results) -> Table:
    """One row a configuration: each figure's mean and deviation, and the thesis's beside it."""
    columns = COLUMNS[table.columns]
    header = ["", "runs"]
    for name, column in columns.items():
        header += [column.title, "thesis"] if name in table.published else [column.title]
    rows: List[Tuple[str, ...]] = []
    for row in table.rows:
        cells = [row.configuration, str(len(results.get(row.configuration, ())))]
        for name, column in columns.items():
            cells.append(_cell(column, *spread(results, row.configuration, column.figure)))
            if name in table.published:
                cells.append(_published(column, row.thesis[name]) if name in row.thesis else UNDEFINED)
        rows.append(tuple(cells))
    return Table(tuple(header), tuple(rows))


def picture_of(table: TableConfig, results: Results) -> Figure:
    """A panel for each column in which the thesis has anything to compare; if there is none, for all."""
    columns = COLUMNS[table.columns]
    panels = []
    for name, column in columns.items():
        if name not in (table.published or columns):
            continue
        values = np.array([spread(results, row.configuration, column.figure) for row in table.rows]) * column.scale
        published = np.array([row.thesis.get(name, np.nan) for row in table.rows])
        panels.append(Panel(f"{column.title} [{column.unit}]", values[:, 0], values[:, 1], published))
    return plot_rows([row.configuration for row in table.rows], panels)


def cost_picture(results: Results) -> Figure:
    """MOTA against CPU, of every configuration that was run and is no variant of another, see VARIANT."""
    known = [name for name in results if VARIANT not in name and np.isfinite(spread(results, name, "mota")[0])]
    shares = np.array([spread(results, name, "cpu_share")[0] for name in known])
    mota = np.array([spread(results, name, "mota") for name in known]).reshape(len(known), 2)
    return plot_cost(known, shares, mota[:, 0], mota[:, 1])


def _cell(column: Column, mean: float, deviation: float) -> str:
    if np.isnan(mean):
        return UNDEFINED
    text = f"{column.scale * mean:.{column.decimals}f}"
    if not np.isnan(deviation):
        text += f" ± {column.scale * deviation:.{column.decimals}f}"
    return f"{text} {column.unit}"


def _published(column: Column, value: float) -> str:
    decimals = 0 if column.unit == "ms" else column.decimals
    return f"{value:.{decimals}f} {column.unit}"
