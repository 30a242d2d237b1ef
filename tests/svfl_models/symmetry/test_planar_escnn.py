import importlib
import subprocess
import sys
from types import ModuleType

import pytest

from svfl_models.symmetry import planar_escnn


@pytest.mark.slow
def test_planar_groups_work_and_importing_is_silent():
    code = "import warnings; warnings.simplefilter('error', UserWarning); "
    code += "from svfl_models.symmetry import planar_escnn as p; "
    code += "assert p.flipRot2dOnR2(4, axis=0.0).fibergroup.order() == 8"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


def test_stand_in_refuses_wigner_matrices(monkeypatch):
    for name in planar_escnn.MODULES:
        monkeypatch.setitem(sys.modules, name, None)  # as if lie-learn were not installed
    assert planar_escnn.stand_in_for_lie_learn() == list(planar_escnn.MODULES)
    wigner_d = importlib.import_module("lie_learn.representations.SO3.wigner_d")
    with pytest.raises(NotImplementedError, match="lie-learn"):
        wigner_d.wigner_D_matrix(1, 0.0, 0.0, 0.0)


def test_real_package_is_left_alone(monkeypatch):
    real = {name: ModuleType(name) for name in planar_escnn.MODULES}
    for name, module in real.items():
        monkeypatch.setitem(sys.modules, name, module)
    assert planar_escnn.stand_in_for_lie_learn() == []
    assert all(sys.modules[name] is module for name, module in real.items())


def test_missing_escnn_says_what_to_run():
    code = "import sys; sys.modules['escnn'] = None; import svfl_models.symmetry.planar_escnn"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    last = done.stderr.strip().splitlines()[-1]
    assert last == "ImportError: escnn is not installed; run: pip install --no-deps escnn==1.0.11"
