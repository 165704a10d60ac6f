"""The software bill of materials: `make sbom` writes docs/sbom.cdx.json from the lock.

No time and no random number: the same lock gives the same bytes. Hashes stand in the lock: of each
library there are many files, of which a machine gets one.
Source: CycloneDX specification 1.5, JSON; Package URL, type pypi.
"""

import json
import sys
from typing import Any

from tools.deps.lock import FILE, OWN, ROOT, LockError, Pin, locked, pins_from_text, project

WRITTEN = ROOT / "docs" / "sbom.cdx.json"


def purl(pin: Pin) -> str:
    return f"pkg:pypi/{pin.name}@{pin.version}"


def bill(pins: dict[str, Pin], on_robot: set[str], version: str) -> dict[str, Any]:
    """All libraries, who needs them, and which a robot has ("required")."""
    own = f"pkg:generic/{OWN}@{version}"
    refs = {OWN: own} | {name: purl(pin) for name, pin in pins.items()}
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {
            "component": {"type": "application", "bom-ref": own, "name": OWN, "version": version}
        },
        "components": [
            {
                "type": "library",
                "bom-ref": purl(pin),
                "name": pin.name,
                "version": pin.version,
                "purl": purl(pin),
                "scope": "required" if name in on_robot else "optional",
            }
            for name, pin in sorted(pins.items())
        ],
        "dependencies": [
            {
                "ref": ref,
                "dependsOn": sorted(purl(pin) for pin in pins.values() if name in pin.needed_by),
            }
            for name, ref in sorted(refs.items())
        ],
    }


def text() -> str:
    """The bill of the lock that there is. Raises LockError, OSError."""
    pins = pins_from_text(FILE.read_text(encoding="utf-8"))
    on_robot = {pin.name for pin in locked()}
    return json.dumps(bill(pins, on_robot, project()["version"]), indent=1) + "\n"


def main() -> int:
    try:
        WRITTEN.write_text(text(), encoding="utf-8")
    except (LockError, OSError) as error:
        print(f"mapod: {error}", file=sys.stderr)
        return 1
    print(f"mapod: {WRITTEN.relative_to(ROOT)} is written")
    return 0


if __name__ == "__main__":
    sys.exit(main())
