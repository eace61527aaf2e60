"""What an evaluation goes on by: the code that an episode runs, and nothing else."""

import pytest

from eval.provenance import code_digest, digest_of

FILES = {
    "eval/__init__.py": '"""Evaluation."""\n',
    "eval/episode.py": "from worlds import registry\n\ndef run():\n    return registry.SIZE\n",
    "eval/report.py": "import vuca_nav.far\n",
    "worlds/__init__.py": "",
    "worlds/registry.py": (
        '"""Worlds."""\n\nSIZE = 3.0\n"""Size [m]."""\n\ndef far():\n    """Tell."""\n    import vuca_nav.far\n'
    ),
    "vuca_nav/far.py": "LONG = None\n",
    "robots/locomotion/weights/go2.safetensors": "weights",
    "robots/locomotion/weights/go2.json": "{}",
}


@pytest.fixture
def tree(tmp_path):
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("eval/report.py", "import vuca_nav.far as far\n"),  # no episode runs it
        ("worlds/more.py", "SIZE = 4.0\n"),
        ("robots/locomotion/weights/go2.json", "{1}"),
        (
            "worlds/registry.py",
            '"""The worlds."""\nSIZE = (3.0)  # metres\n"""[m]"""\ndef far():\n    import vuca_nav.far\n',
        ),
    ],
)
def test_what_decides_no_bit_changes_nothing(tree, name, text):
    before = digest_of(tree)
    (tree / name).write_text(text)
    assert digest_of(tree) == before


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("worlds/registry.py", FILES["worlds/registry.py"].replace("3.0", "3.5")),
        ("worlds/registry.py", FILES["worlds/registry.py"].replace("far()", "far(x)")),
        ("worlds/__init__.py", "import os\n"),  # runs on the way
        ("vuca_nav/far.py", "LONG = 0\n"),  # imported within a function
        ("robots/locomotion/weights/go2.safetensors", "other"),
    ],
)
def test_what_decides_a_bit_changes_the_digest(tree, name, text):
    before = digest_of(tree)
    (tree / name).write_text(text)
    assert digest_of(tree) != before


def test_the_digest_is_of_this_project():
    assert len(code_digest()) == 16
    assert code_digest() == code_digest()
