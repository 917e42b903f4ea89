"""Work on a cluster of several Ray nodes on this machine: the bits of one process, whatever dies."""

import json
import os
import time
from pathlib import Path

import numpy as np
import pytest

ray = pytest.importorskip("ray")
pytest.importorskip("pyarrow")

from ray.cluster_utils import Cluster  # noqa: E402

from smpl.benchmark import benchmark  # noqa: E402
from smpl.collect import main as collect_main  # noqa: E402
from smpl.datasets import collect, load  # noqa: E402
from smpl.learning import Plan, Task  # noqa: E402
from smpl.learning.cluster import spread_on_ray  # noqa: E402
from smpl.learning.scores import score  # noqa: E402
from smpl_benchmarks.subjects import runs  # noqa: E402

NODE = {"num_cpus": 1, "object_store_memory": 100 * 2**20}


@pytest.fixture(scope="module")
def cluster():
    """A head that runs nothing, and two nodes."""
    # What the nodes start must find this module.
    before = os.environ.get("PYTHONPATH", "")
    os.environ["PYTHONPATH"] = os.pathsep.join([str(Path(__file__).parent), before])
    made = Cluster(initialize_head=True, head_node_args={**NODE, "num_cpus": 0, "include_dashboard": False})
    for _ in range(2):
        made.add_node(**NODE)
    ray.shutdown()  # what other tests have started in this process
    ray.init(address=made.address, log_to_driver=False)
    yield made
    ray.shutdown()
    made.shutdown()
    os.environ["PYTHONPATH"] = before


def squared(shared, piece):
    time.sleep(0.3)
    return shared + piece * piece


def failing(shared, piece):
    raise ValueError(f"piece {piece} cannot be done")


class Dying:
    """A controller that ends its worker's process once for each marker that it finds."""

    def __init__(self, folder):
        self.folder = folder

    def reset(self, env):
        for marker in sorted(self.folder.glob("die-*")):
            marker.unlink(missing_ok=True)
            os._exit(9)

    def action(self, env):
        return np.array([26.85, 0.1])


def test_nodes_that_are_killed_lose_nothing_and_count_nothing_twice(cluster):
    results = []
    for number, one in enumerate(spread_on_ray(squared, 5, range(24), "auto")):
        results.append(one)
        if number in (2, 9):
            node = min(cluster.worker_nodes, key=lambda one: one.node_id)
            cluster.remove_node(node, allow_graceful=False)
            cluster.add_node(**NODE)
    assert sorted(results) == [(k, 5 + k * k) for k in range(24)]


def test_the_error_of_a_piece_is_that_of_one_process(cluster):
    with pytest.raises(ValueError, match="piece 3 cannot be done"):
        list(spread_on_ray(failing, None, [3], "auto"))


def test_collection_has_the_bytes_of_one_process(cluster, tmp_path):
    arguments = {"seed": 3, "noise": 0.1, "part": 4, "max_steps": 10}
    collect("reactor", ["pid", "random"], 14, tmp_path / "one", workers=1, **arguments)
    collect("reactor", ["pid", "random"], 14, tmp_path / "many", ray="auto", **arguments)
    parts = sorted(file.name for file in (tmp_path / "one").glob("part-*"))
    assert len(parts) == 4 and parts == sorted(file.name for file in (tmp_path / "many").glob("part-*"))
    for name in parts:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "many" / name).read_bytes()


def test_workers_that_die_are_replaced(cluster, tmp_path):
    marks = tmp_path / "marks"
    marks.mkdir()
    arguments = {"part": 2, "max_steps": 5}
    collect("reactor", Dying(marks), 8, tmp_path / "one", workers=1, **arguments)
    for k in range(3):
        (marks / f"die-{k}").touch()
    plan = Plan.of(Task.of("reactor", max_steps=5), Dying(tmp_path), 40)  # checked here: nothing to die of
    object.__setattr__(plan.agents[0].chooser, "folder", marks)
    found = score(plan, ray="auto")
    assert not list(marks.iterdir())
    expected = score(plan, 1)
    np.testing.assert_array_equal(found.returns, expected.returns)
    assert [one.seed for one in found.summaries] == list(range(40))
    assert len(load(tmp_path / "one")) == 8


def test_scores_are_those_of_one_process(cluster):
    task = Task.of("reactor", scenario="legacy", max_steps=15)
    for controller, episodes in (("pid", 1500), ("nominal", 20)):
        plan = Plan.of(task, controller, episodes, seed=1)
        one, many = score(plan, 1), score(plan, ray="auto")
        np.testing.assert_array_equal(one.returns, many.returns)
        assert one.pooled() == many.pooled() and len(many.kept) == len(one.kept)


def test_runs_of_the_benchmark_come_back_whole(cluster, tmp_path):
    benchmark(tmp_path / "one", env="Beer", workers=1)
    benchmark(tmp_path / "many", env="Beer", ray="auto")
    files = sorted(file.relative_to(tmp_path / "one") for file in (tmp_path / "one").rglob("scores.json"))
    assert {file.parts[2] for file in files} == {one.controller for one in runs("control", "smoke", "Beer", 1)}
    for file in files:
        one, many = (json.loads((tmp_path / which / file).read_text()) for which in ("one", "many"))
        assert one["returns"] == many["returns"] and one["std"] == many["std"]
    kept = tmp_path / "many" / files[0]
    before = kept.stat().st_mtime_ns
    benchmark(tmp_path / "many", env="Beer", ray="auto", resume=True)
    assert kept.stat().st_mtime_ns == before


def test_a_cluster_that_is_not_there_is_told(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "ray", None)
    given = ["reactor", "--episodes", "2", "--out", str(tmp_path), "--quiet", "--ray", "auto"]
    assert collect_main(given) == 1
    assert "pip install ray" in capsys.readouterr().err
