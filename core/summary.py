"""The robot that the settings describe, in words, for a person to check against the real one."""

import math

import numpy as np

from core.config import Config
from core.driving.control import link_refusal, links_refusal
from core.geometry import R_from_rpy
from core.mapping.surface.cells import CELL

BYTES_PER_CELL = CELL.itemsize + 18  # its record; slope, step, roughness, marks
BYTES_PER_WINDOW_CELL = 1 + 1 + 8 + 4  # obstacle map, its change list, what the link keeps
FRAMES_BYTES = 38 + 26  # a POSE frame and the head of a MAP frame on a serial line
CHANGES_BYTES = 80  # operations per tick, mean of a drive (planner link, section 10)
FULL_MAP_BYTES_PER_CELL = 0.055  # runs of a whole map, mean of a drive (same)
PASSES_PER_S = 2.0  # rolling refresh
LINE_SHARE = 0.85  # of what a line carries is used


def describe_robot(config: Config, line_bauds: list[int | None]) -> str:
    """A dozen lines: what the laser sees of the ground, map sizes, memory, link rate.

    Args:
        line_bauds: of each of the planner's ports, if it is a serial line; None for others.
    """
    scanner = config.scanner
    cells, window = config.map.cells, config.obstacle.window_cells
    memory_mb = (cells**2 * BYTES_PER_CELL + window**2 * BYTES_PER_WINDOW_CELL) / 1e6
    lines = [
        f"scanner   {scanner.driver} at {scanner.port}: {scanner.options.describe()}",
        f"          {scanner.mount_z_m:g} m above the ground, looking "
        f"{abs(scanner.mount_tilt_deg):g} deg {'down' if scanner.mount_tilt_deg >= 0 else 'up'}",
        *(f"          {line}" for line in _describe_ground(config)),
        f"ahrs      {config.ahrs.driver} at {config.ahrs.port}: {config.ahrs.options.describe()}",
        *_describe_depth(config),
        *_describe_coverage(config),
        *_describe_motion(config),
        "motors    " + "\n          ".join(_describe_motors(config)),
        f"map       method {config.map.method}, {cells} x {cells} cells of "
        f"{config.map.cell_m:g} m = {cells * config.map.cell_m:.1f} m square, {memory_mb:.1f} MB",
        f"obstacle  from {config.obstacle.h_pos_m:+g} m up or {config.obstacle.h_neg_m:+g} m down; "
        f"the planner gets {window} x {window} cells",
    ]
    for url, baud in zip(config.planner.ports, line_bauds, strict=True):
        lines += _describe_link(config, url, baud)
    lines += [f"modbus    {url}" for url in config.modbus.ports]
    return "\n".join(lines)


def _describe_depth(config: Config) -> list[str]:
    """Where a depth camera looks; nothing where there is none."""
    depth = config.depth
    if depth is None or not config.has_camera:
        return []
    tilt, down = abs(depth.mount_tilt_deg), "down" if depth.mount_tilt_deg >= 0 else "up"
    return [
        f"depth     {depth.driver} at {depth.port}: {depth.options.describe()}",
        f"          {depth.mount_z_m:g} m above the ground, looking {tilt:g} deg {down}",
    ]


def _describe_coverage(config: Config) -> list[str]:
    """For which machine paths are planned; nothing where nobody plans."""
    coverage = config.coverage
    if coverage is None or not coverage.plan:
        return []
    return [
        f"coverage  sweeps a band of {coverage.width_m:g} m; the machine counts as a disc of "
        f"{coverage.radius_m:g} m, {coverage.clearance_m + coverage.guard_m:g} m from what stands"
    ]


def _describe_motion(config: Config) -> list[str]:
    """What tells the place, and what could move the robot."""
    drive, robot = config.drive, config.robot
    at = f" at {drive.port}" if drive.port else ""
    words = f"drive     {drive.driver}{at}: {drive.options.describe()}"
    if config.motion.source == "external":
        place = "comes as EXTERNAL_POSE frames over a planner's port; no wheels are counted"
        if refusal := links_refusal(config.planner.ports, bool(config.planner.key_file)):
            place = f"can't be told: {refusal}"
        return [words, f"motion    the place {place}"]
    counts_per_m = 2 * robot.encoder_ppr * robot.gear_ratio / (math.pi * robot.wheel_radius_m)
    lines = [f"{words}, {counts_per_m:.0f} counts per metre"]
    if config.motion.source == "rail":
        lines.append("motion    along a straight rail, by the encoder of drive.left_channel alone")
    return lines


def _describe_link(config: Config, url: str, line_baud: int | None) -> list[str]:
    """What one receiver gets, and whether its line carries it."""
    rate_hz = config.planner.rate_hz
    if not config.planner.push:
        return [f"planner   {url}: what it asks for, up to {rate_hz:g} times a second"]
    needed = rate_hz * (FRAMES_BYTES + CHANGES_BYTES)
    needed += PASSES_PER_S * FULL_MAP_BYTES_PER_CELL * config.obstacle.window_cells**2
    words = f"planner   {url}, {rate_hz:g} frames/s: needs about {needed:.0f} bytes/s"
    if line_baud is None:
        return [words]
    carried = line_baud / 10 * LINE_SHARE
    lines = [f"{words}, the line carries {carried:.0f}"]
    if needed > carried:
        lines.append(
            "          too little: cells will come late; lower planner.rate_hz or raise baud"
        )
    return lines


def _describe_motors(config: Config) -> list[str]:
    robot = config.robot
    if not robot.enable_motors:
        return ["never move (robot.enable_motors is false)"]
    key = bool(config.planner.key_file)
    refusals = {url: link_refusal(url, key, True) for url in config.planner.ports}
    willing = [url for url, refusal in refusals.items() if not refusal]
    willing += [
        f"Modbus at {url}"
        for url in config.modbus.ports
        if config.modbus.allow_drive and not link_refusal(url, False, True)
    ]
    lines = [
        f"move on requests over {' or '.join(willing)}"
        + (", signed with the key" if config.planner.key_file else ", which nobody has to sign")
        + f": up to {robot.max_speed_mps:g} m/s and {robot.max_turn_radps:g} rad/s",
        f"a body from {robot.front_m:g} m ahead of the axle to {robot.rear_m:g} m behind it, "
        f"{robot.width_m:g} m wide, stops {robot.stop_margin_m:g} m before obstacles",
    ]
    if not willing:
        lines[0] = f"never move: {next(iter(refusals.values()))}"
    unseen = "and before ground it has not seen"
    if not robot.unknown_stops:
        unseen = "and drives onto ground that it has not seen"
    elif robot.start_clear_m > 0:
        unseen += f", but for {robot.start_clear_m:g} m around the start, which must be clear"
    else:
        unseen += ": it cannot set out (robot.start_clear_m is 0)"
    return [*lines, unseen]


def _describe_ground(config: Config) -> list[str]:
    """Where the centre beam meets the ground, and how wide the seen strip of ground is."""
    scanner = config.scanner
    R_body_sensor = R_from_rpy(*scanner.mount_rpy_rad)
    spec = scanner.options.spec
    rays = np.vstack([spec.directions, [1.0, 0.0, 0.0]]) @ R_body_sensor.T
    down = np.maximum(-rays[:, 2], 1e-9)
    ranges_m = scanner.mount_z_m / down
    points = rays * ranges_m[:, None] + scanner.mount_xyz_m
    seen = ranges_m <= spec.max_range_m
    if not seen[-1]:
        return [f"its centre beam meets no ground within {spec.max_range_m:g} m"]
    across_m = points[seen, 1]
    return [
        f"centre beam meets the ground {points[-1, 0]:.2f} m ahead of the axle "
        f"(range {ranges_m[-1]:.2f} m)",
        f"width of ground seen there: {across_m.max() - across_m.min():.1f} m",
    ]
