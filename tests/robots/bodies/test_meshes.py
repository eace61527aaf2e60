import numpy as np
import pytest
import trimesh

from robots.bodies.assets import MissingAsset, asset
from robots.bodies.meshes import cache_folder, load_mesh

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


def test_the_cache_gives_the_same_mesh_and_survives_being_broken():
    first = load_mesh(asset(WHEEL))
    (entry,) = cache_folder().iterdir()
    second = load_mesh(asset(WHEEL))
    entry.write_bytes(b"not an archive")
    third = load_mesh(asset(WHEEL))
    for a, b, c in zip(first, second, third):
        np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(a, c)
    assert [file.suffix for file in cache_folder().iterdir()] == [".npz"]  # no temporary files left


def test_works_without_a_writable_cache(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    vertices, _ = load_mesh(asset(WHEEL))
    assert len(vertices) > 100


def test_a_file_that_is_no_mesh_is_named(tmp_path):
    (tmp_path / "bad.stl").write_text("solid nothing")
    with pytest.raises(MissingAsset, match=r"bad\.stl"):
        load_mesh(tmp_path / "bad.stl")
