"""Pictures as Plotly figures (`pip install whorl[plots]`)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, List

from . import explain
from ._native import WhorlError
from .recording import Recording

if TYPE_CHECKING:
    from .trends import Trends


def _plotly() -> Any:
    try:
        import plotly.graph_objects
        import plotly.subplots
    except ImportError:
        raise WhorlError("figures need Plotly: pip install plotly") from None
    return plotly


def recording(run: Recording, keys: List[str]) -> Any:
    """Channels over time, one below the other."""
    plotly = _plotly()
    figure = plotly.subplots.make_subplots(rows=max(1, len(keys)), cols=1, shared_xaxes=True, vertical_spacing=0.02)
    for row, key in enumerate(keys, start=1):
        time_s, values, unit, components = run[key]
        columns = values.reshape(len(time_s), -1)
        for k, component in enumerate(components):
            name = f"{key} {component}".strip()
            figure.add_scattergl(x=time_s, y=columns[:, k], name=name, row=row, col=1)
        figure.update_yaxes(title_text=f"{key}<br>[{unit}]", row=row, col=1)
    figure.update_xaxes(title_text="time [s]", row=max(1, len(keys)), col=1)
    return figure.update_layout(title=f"{run.name}: {run.platform}", height=120 + 160 * max(1, len(keys)))


def trends(found: "Trends", most: int) -> Any:
    """Parameters over runs, those that changed most surely first."""
    plotly = _plotly()
    shown = sorted(found.parameters, key=lambda p: p["change"]["chance"] if p["change"] else 1.0)[: max(1, most)]
    titles = [f"{p['group']} {p['name']} [{p['unit']}]" for p in shown]
    figure = plotly.subplots.make_subplots(rows=max(1, len(shown)), cols=1, shared_xaxes=True, subplot_titles=titles)
    for row, parameter in enumerate(shown, start=1):
        estimates = parameter["estimates"]
        figure.add_scatter(
            x=[found.run_names[e["run"]] for e in estimates],
            y=[e["value"] for e in estimates],
            error_y={"type": "data", "array": [e["stddev"] for e in estimates]},
            mode="markers",
            row=row,
            col=1,
        )
    figure.update_layout(showlegend=False, height=180 * max(2, len(shown)))
    return figure


def of(answer: "explain.Answer") -> Any:
    """The main picture of an answer."""
    plotly = _plotly()
    figure = plotly.graph_objects.Figure()
    if isinstance(answer, explain.Comparison):
        several = len(answer.data["runs"]) > 1
        for run in answer.data["runs"]:
            names = [channel["name"] for channel in run["channels"]]
            for k, horizon in enumerate(run["channels"][0]["horizons"] if names else []):
                ratios = [channel["horizons"][k]["ratio"] for channel in run["channels"]]
                label = explain.horizon_name(horizon) + (f", {run['run']}" if several else "")
                figure.add_bar(x=names, y=ratios, name=label)
        figure.add_hline(y=1.0, line_dash="dot", annotation_text="noise")
        figure.update_layout(title="Prediction error over noise", yaxis_title="error / noise")
    elif isinstance(answer, explain.Located):
        for of, ranked in answer.ranked.items():
            best = ranked[:12][::-1]
            figure.add_bar(
                x=[100 * d["share"] for d in best],
                y=[f"{d['variable']} ({d['frame'] if of == 'body' else of})" for d in best],
                orientation="h",
                name=of,
            )
        figure.update_layout(title="Share of the excess that each quantity explains", xaxis_title="[%], shares overlap")
    elif isinstance(answer, explain.Diagnosis):
        best = answer.candidates[:12][::-1]
        colours = ["#1f77b4" if c["effect"] in answer.effects else "#bbbbbb" for c in best]
        figure.add_bar(
            x=[c["delta_log_evidence"] for c in best],
            y=[c["effect"] for c in best],
            orientation="h",
            marker_color=colours,
        )
        figure.update_layout(title=answer.answer[0] if answer.answer else "", xaxis_title="log evidence over the model as it is")
    elif isinstance(answer, explain.Discovery):
        laws = [law for law in answer.laws if law["equation"]][:8][::-1]
        figure.add_bar(x=[100 * law["probability"] for law in laws], y=[law["equation"] for law in laws], orientation="h")
        figure.update_layout(title="Laws that were weighed", xaxis_title="probability [%]")
    elif isinstance(answer, explain.Adoption):
        names = [v["name"] for v in answer.versions]
        figure.add_bar(x=names, y=[v["prediction_error"] for v in answer.versions], name="training")
        if any(v["held_out_prediction_error"] is not None for v in answer.versions):
            figure.add_bar(x=names, y=[v["held_out_prediction_error"] for v in answer.versions], name="held out")
        figure.add_hline(y=1.0, line_dash="dot", annotation_text="noise")
        figure.update_layout(title="Prediction error over noise", yaxis_title="error / noise")
    elif isinstance(answer, explain.Identification):
        names = [f"{p['name']} [{p['unit']}]" for p in answer.parameters]
        moved = [(p["estimate"] - p["before"]) / p["prior_stddev"] for p in answer.parameters]
        error = {"type": "data", "array": [p["stddev"] / p["prior_stddev"] for p in answer.parameters]}
        figure.add_scatter(x=names, y=moved, error_y=error, mode="markers")
        figure.add_hline(y=0.0, line_dash="dot")
        figure.update_layout(title="Mass properties", yaxis_title="change / prior's standard deviation")
    else:
        raise WhorlError(f"there is no picture of {type(answer).__name__}")
    return figure
