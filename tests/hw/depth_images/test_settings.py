"""[depth] with the keys that docs/devices.md tells, and ports that do not fit the driver."""

import re
from typing import Any

import pytest

from config_file import load_config
from core.config import Config, ConfigError
from hw.depth_images.options import FolderOptions, KinectOptions
from hw.depth_images.session import DepthImages
from hw.device import NoPort
from hw.registry import DEPTH_CAMERAS, Surroundings
from tests import ROOT
from wiring import check_ports

SHIPPED = (ROOT / "mapod.toml").read_text(encoding="utf-8")
TOLD = re.findall(r"```toml\n(\[depth\]\n.*?)```", (ROOT / "docs/devices.md").read_text(), re.S)
SECTIONS = {re.findall(r'driver = "(\w+)"', text)[0]: text for text in TOLD}


def config_with(driver: str, before: str = "", instead: str = "") -> Config:
    rest = SHIPPED[: SHIPPED.index("[depth]")] + SHIPPED[SHIPPED.index("[objects]") :]
    return load_config(SECTIONS[driver].replace(before, instead, 1) + rest)


@pytest.mark.parametrize(("driver", "kind"), [("kinect", KinectOptions), ("folder", FolderOptions)])
def test_the_documents_sections_make_a_camera(driver: str, kind: type[Any]) -> None:
    config = config_with(driver)
    check_ports(config)
    assert config.depth is not None
    assert isinstance(config.depth.options, kind)
    assert config.depth.options.describe()
    around = Surroundings(config.depth.port, 0.0, False)
    camera = DEPTH_CAMERAS[driver].make(NoPort(), config.depth.options, around)
    assert isinstance(camera, DepthImages)
    assert camera.status.name == driver


@pytest.mark.parametrize(
    ("driver", "before", "instead", "told"),
    [
        ("kinect", "kinect:///0?format=mm", "folder:///x", "only scanner.driver = 'stripe' or dep"),
        ("kinect", "kinect:///0?format=mm", "tcp://a:1", "must begin with kinect:/// or fakenect"),
        ("kinect", "?format=mm", "", "format must be mm or raw, is missing"),
        ("kinect", "[580.0, 580.0]", "[5800.0, 580.0]", "fx 5800, cx 319.5 for 640 px"),
        ("kinect", "[580.0, 580.0]", "[inf, 580.0]", "fx inf, cx 319.5 for 640 px"),
        ("kinect", "[319.5, 239.5]", "[319.5, nan]", "cy nan for 480 px"),
        ("kinect", "shift = 200", "shift = 900", "from 0 to 500, is 900"),
        ("kinect", "emitter_m", "emiter_m", "emiter_m"),
        ("folder", "folder:///home", "kinect:///0?format=mm#", "depth.port"),
        ("folder", "folder:///home/robot/frames", "fakenect:///x", "only depth.driver = 'kinect'"),
        ("folder", "period_s = 0.033", "period_s = 0.0", "from 0.005 to 5, is 0.0"),
    ],
)
def test_what_does_not_fit_is_told_before_any_port_opens(
    driver: str, before: str, instead: str, told: str
) -> None:
    with pytest.raises(ConfigError) as found:
        check_ports(config_with(driver, before, instead))
    assert told in str(found.value)
