"""What the planner is told of pose and health, from the maps' state at one instant.

Source: planner link, section 3; design, section 8.
"""

import math

from core.driving import health
from core.mapping.mapper import Mapper
from core.records import PoseReport


def report(
    mapper: Mapper,
    now_s: float,
    *,
    clocks_locked: bool,
    overrun: bool,
    replayed: bool,
    impaired: bool,
    stop_asked: bool,
    drop_ahead: bool,
    stalled: bool,
    scan_stale_s: float,
) -> tuple[bool, PoseReport]:
    """Whether free may be told, and the pose and health for the planner."""
    pose = mapper.maybe_pose(now_s)
    roll_rad, pitch_rad, _ = mapper.attitudes.newest_rpy()
    age_scan_s, age_ahrs_s = now_s - mapper.newest_scan_s, now_s - mapper.attitudes.newest_s
    age_wheels_s = now_s - mapper.place_told_s
    word, mode = health.health_of(
        age_scan_s=age_scan_s,
        age_scanner_s=now_s - mapper.delivered_scan_s,
        age_ahrs_s=age_ahrs_s,
        age_wheels_s=age_wheels_s,
        scan_stale_s=scan_stale_s,
        clocks_locked=clocks_locked,
        pose_known=pose is not None,
        map_begun=mapper.counts.scans_added > 0,
        overrun=overrun,
        tilt_rad=max(abs(roll_rad), abs(pitch_rad)),
        replayed=replayed,
        drop_ahead=drop_ahead,
        impaired=impaired,
        stop_asked=stop_asked,
        stalled=stalled,
    )
    rate_z_radps = mapper.attitudes.rate_body_radps[2]
    return bool(word & health.MAP_VALID), PoseReport(
        x_m=pose.x_m if pose else 0.0,
        y_m=pose.y_m if pose else 0.0,
        yaw_rad=pose.yaw_rad if pose else 0.0,
        pitch_rad=pitch_rad,
        roll_rad=roll_rad,
        v_mps=mapper.odometry.v_mps if pose else 0.0,
        w_radps=mapper.odometry.w_radps if math.isnan(rate_z_radps) else rate_z_radps,
        health=word,
        age_scan_s=age_scan_s,
        age_ahrs_s=age_ahrs_s,
        age_enc_s=age_wheels_s,
        mode=mode,
    )
