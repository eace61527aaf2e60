import pwd

import numpy as np
import pytest
import trimesh

from robots.bodies.assets import MissingAsset, asset
from robots.bodies.meshes import load_mesh

WHEEL = "tiago_description/meshes/pmb2/wheels/wheel.stl"


@pytest.fixture(autouse=True)
def own_cache(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def test_thinning_keeps_the_shape_and_drops_triangles():
    full = trimesh.load_mesh(asset(WHEEL))
    vertices, faces = load_mesh(asset(WHEEL))
    assert len(faces) < 0.8 * len(full.faces)
    np.testing.assert_allclose(vertices.min(axis=0), full.bounds[0], atol=0.008)
    np.testing.assert_allclose(vertices.max(axis=0), full.bounds[1], atol=0.008)
    assert faces.min() == 0
    assert faces.max() == len(vertices) - 1


@pytest.mark.parametrize("damage", [lambda data: b"", lambda data: data[:500], lambda data: data[:-900] + data[-899:]])
def test_the_cache_gives_the_same_mesh_and_is_made_again_if_it_is_damaged(tmp_path, caplog, damage):
    first = load_mesh(asset(WHEEL))
    (entry,) = (tmp_path / "cache" / "vuca-nav" / "meshes").iterdir()
    second = load_mesh(asset(WHEEL))
    assert not caplog.records
    whole = entry.read_bytes()
    entry.write_bytes(damage(whole))
    third = load_mesh(asset(WHEEL))
    assert [record.getMessage() for record in caplog.records] == [f"{entry} is damaged; it is made again"]
    for a, b, c in zip(first, second, third):
        np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(a, c)
    assert [file.suffix for file in entry.parent.iterdir()] == [".npz"]  # no temporary files left
    assert len(entry.read_bytes()) == len(whole)


def test_works_without_a_place_for_the_cache(monkeypatch, tmp_path):
    def unknown(_):
        raise KeyError

    (tmp_path / "file").write_text("")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "file"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert len(load_mesh(asset(WHEEL))[0]) > 100
    for name in ("XDG_CACHE_HOME", "HOME"):
        monkeypatch.delenv(name)
    monkeypatch.setattr(pwd, "getpwuid", unknown)  # a user that the system does not know
    assert len(load_mesh(asset(WHEEL))[0]) > 100


def test_a_file_that_is_no_mesh_is_named(tmp_path):
    (tmp_path / "bad.stl").write_text("solid nothing")
    with pytest.raises(MissingAsset, match=r"bad\.stl"):
        load_mesh(tmp_path / "bad.stl")
