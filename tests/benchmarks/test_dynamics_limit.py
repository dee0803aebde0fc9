import pytest
from click.testing import CliRunner

from benchmarks import dynamics_limit
from benchmarks.dynamics_limit import KNITLAB, LOOP, main, prepared


def test_the_compiled_loop_moves_as_knitlab_does():
    pytest.importorskip("numba")
    nodes, (_, differences), moves = prepared("1,1", [KNITLAB, LOOP])
    assert nodes == 17 * 17
    assert max(differences) < 1e-10
    assert len(moves) == 2


def test_without_numba_one_sentence_says_so(monkeypatch, tmp_path):
    monkeypatch.setattr(dynamics_limit, "find_spec", lambda name: None)
    ran = CliRunner().invoke(main, ["--results", str(tmp_path)])
    assert ran.exit_code == 2
    assert "Numba is not installed; run pip install 'knitlab[benchmarks]'" in ran.output
    assert not list(tmp_path.iterdir())
