"""The documents' pictures: each is listed with the code that draws it, and is not older."""

import re
from pathlib import Path

import pytest

from tests import ROOT
from tools.docs.pictures import (
    PICTURES,
    digest_of,
    made,
    older_than_their_code,
    record,
    with_neighbours,
)


def test_no_picture_is_older_than_the_code_that_draws_it() -> None:
    assert older_than_their_code() == []


def test_each_picture_is_listed_and_each_that_is_listed_is_there() -> None:
    assert {path.name for path in PICTURES.glob("*.png")} == set(made())


def test_the_commands_that_draw_them_exist() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for name, entry in made().items():
        target = re.fullmatch(r"make (\S+)", str(entry["by"]))
        assert target, name
        assert re.search(rf"^{target[1]}:", makefile, re.MULTILINE), name


def test_a_change_of_the_code_is_noticed(tmp_path: Path) -> None:
    drawn_by, listed = tmp_path / "draws.py", tmp_path / "made_of.json"
    drawn_by.write_text("blue")
    (tmp_path / "a.png").touch()
    before = digest_of(["draws.py"], tmp_path)
    drawn_by.write_text("red")
    assert digest_of(["draws.py"], tmp_path) != before
    record(["a.png", "not_there.png"], "make pictures", ["tools/docs/pictures.py"], listed)
    assert set(made(listed)) == {"a.png"}
    assert older_than_their_code(listed) == []
    changed = listed.read_text().replace('"digest": "', '"digest": "0')
    listed.write_text(changed)
    assert older_than_their_code(listed) == ["a.png: make pictures"]
    with pytest.raises(ValueError, match=r"gone\.py"):
        digest_of(["gone.py"])


def test_a_module_is_drawn_by_what_it_imports_of_its_folder_and_by_nothing_else() -> None:
    assert with_neighbours("tools/objects/pictures.py") == [
        "tools/objects/frames.py",
        "tools/objects/pictures.py",
    ]
    steps = with_neighbours("core/objects/frame/steps.py")
    assert {"core/objects/frame/view.py", "core/objects/frame/voxels.py"} < set(steps)
    assert "core/objects/vector_map/object_map.py" not in steps
