"""The import graph of the project's packages: which way, import-linter checks; here that no way leads back."""

import graphlib

import grimp

PACKAGES = ("vuca_nav", "worlds", "robots", "eval", "train")


def circle(imports):
    """Modules of which each imports the one before it and the last is the first again, or nothing."""
    try:
        graphlib.TopologicalSorter(imports).prepare()
    except graphlib.CycleError as error:
        return error.args[1]
    return None


def test_a_circle_is_found():
    assert circle({"a": {"b"}, "b": {"c"}, "c": set()}) is None
    assert set(circle({"a": {"b"}, "b": {"c"}, "c": {"a"}, "d": {"a"}}) or ()) == {"a", "b", "c"}


def test_no_module_imports_itself_by_way_of_others():
    """Imports behind TYPE_CHECKING and within functions count, too."""
    graph = grimp.build_graph(*PACKAGES, cache_dir=None)
    found = circle({module: graph.find_modules_directly_imported_by(module) for module in graph.modules})
    assert found is None, f"each imports the one before it: {found}"
