"""A moment, as `moment_of` gives it, in lines for a person."""

from collections.abc import Iterator
from typing import Any

from tools.why.words import span

Facts = dict[str, Any]


def lines_of(story: Facts) -> Iterator[str]:
    """The whole story, the moment's time first."""
    moment, begin_s = story["moment"], story["begin_s"]
    yield f"{story['utc']} UTC, {story['t_s'] - begin_s:.2f} s after the recording's begin"
    yield from _of_pose(moment)
    yield from _of_stands(moment["stands"], begin_s)
    yield from _of_zone(moment["zone"])
    yield from _of_inputs(moment)
    yield from _of_past(moment, story["log"], begin_s)
    if story["cell"] is not None:
        yield from _of_cell(story["cell"], story["t_s"])


def _of_pose(moment: Facts) -> Iterator[str]:
    pose = moment["pose"]
    where = "the pose is not known"
    if pose is not None:
        where = (
            f"at x {pose['x_m']:.2f} m, y {pose['y_m']:.2f} m, yaw {pose['yaw_deg']:.1f} deg, "
            f"pitch {pose['pitch_deg']:.1f}, roll {pose['roll_deg']:.1f}; "
            f"{pose['v_mps']:.2f} m/s, {pose['w_radps']:.2f} rad/s"
        )
    yield f"robot: {moment['mode']}, {where}"
    for doubt in moment["doubts"]:
        yield f"  but {doubt}"


def _of_stands(stands: Facts, begin_s: float) -> Iterator[str]:
    if asked := stands["asked"]:
        yield (
            f"asked: {asked['v_mps']:.2f} m/s, {asked['w_radps']:.2f} rad/s by {asked['by']}, "
            f"for {asked['left_s']:.2f} s more"
        )
    else:
        yield "asked: nobody asks the robot to move"
    if not stands["may_move"]:
        yield "mapod moves no motor: the motors are not enabled"
    elif stands["reason"]:
        yield f"stands: {stands['reason']}"
    else:
        commanded = stands["commanded"]
        yield f"told: {commanded['v_mps']:.2f} m/s, {commanded['w_radps']:.2f} rad/s"
    if bars := stands["way_ends_at"]:
        drop = ", a drop" if bars["is_drop"] else ""
        yield f"its way ends after {bars['free_m']:.2f} m{drop} at {_cell(bars)}"
    else:
        yield "nothing is in its way"
    if stands["within_margin"]:
        yield f"within its margin: {stands['within_margin']} cells that are not free, the nearest"
        for cell in stands["nearest"]:
            yield f"  {_cell(cell)}"
    for stop in stands["stops"]:
        after = f"{stop['t_s'] - begin_s:9.2f} s"
        yield f"  {after}: {stop['reason'] or 'may move'}" + (
            f": {_cell(stop['cell'])}" if stop["cell"] else ""
        )


def _of_zone(zone: Facts) -> Iterator[str]:
    causes = f" ({', '.join(zone['causes'])})" if zone["causes"] else ""
    yield (
        f"stop zone: {zone['state']}{causes}; free ahead {_metres(zone['free_ahead_m'])}, behind "
        f"{_metres(zone['free_behind_m'])}; allowed {zone['allowed_ahead_mps']:.2f} and "
        f"{zone['allowed_behind_mps']:.2f} m/s; nearest obstacle {_metres(zone['nearest_m'])}"
    )


def _of_inputs(moment: Facts) -> Iterator[str]:
    for one in moment["inputs"]:
        age = "" if one["age_s"] is None else f", {span(one['age_s'])} old"
        losses = f", lost {one['losses']} times" if one["losses"] else ""
        rejected = ""
        if one["frames_rejected"]:
            why = f" ({', '.join(one['reasons'])})" if one["reasons"] else ""
            rejected = f", {one['frames_rejected']} frames rejected{why}"
        cause = f": {one['cause']}" if one["cause"] else ""
        yield f"{one['name']}: {one['state']}{age}{losses}{rejected}{cause}"


def _of_past(moment: Facts, log: list[Facts], begin_s: float) -> Iterator[str]:
    for restart in moment["restarts"]:
        yield f"restart at {restart['t_s'] - begin_s:.2f} s: {restart['what']}"
    for what, reasons in moment["refusals"].items():
        for reason, count in reasons.items():
            yield f"refused: {count} {what}: {reason}"
    for line in log:
        keys = " ".join(f"{name}={value}" for name, value in line["keys"].items())
        yield f"log {line['t_s'] - begin_s:9.2f} s: {line['event']} {keys}"


def _of_cell(cell: Facts, now_s: float) -> Iterator[str]:
    yield f"the cell: {_cell(cell)}"
    if "told" in cell:
        yield f"  told to planners as {cell['told']}"
    known = [f"{name} {cell[name]:.3f}" for name in ("z", "slope") if cell[name] is not None]
    if "counts" in cell:
        known += [f"{count:g} {about}" for about, count in cell["counts"].items() if count]
    if known:
        yield f"  {', '.join(known)}"
    for change in cell["changes"]:
        yield f"  {span(now_s - change['t_s'])} ago it became {change['to']} ({change['cause']})"
    for kind, how in (("met", "met it"), ("passed", "passed")):
        for beam in cell[kind]:
            yield (
                f"  {span(now_s - beam['t_s'])} ago beam {beam['beam']} of scan {beam['scan']} "
                f"{how} at {beam['range_m']:.2f} m, z {beam['z_m']:.2f} m"
            )


def _cell(cell: Facts) -> str:
    return f"cell {cell['i']},{cell['j']} ({cell['x_m']:.2f}, {cell['y_m']:.2f} m): {cell['text']}"


def _metres(length_m: float | None) -> str:
    return "none known" if length_m is None else f"{length_m:.2f} m"
