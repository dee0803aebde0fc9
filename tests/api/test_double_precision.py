"""No public function computes in single precision, whatever JAX is set to."""

import doctest
import logging

import jax
import pytest

import knitlab as kl

EXAMPLES = {
    test.name: test
    for name in dir(kl)
    if name != "plot"
    for test in doctest.DocTestFinder().find(getattr(kl, name), name)
    if test.examples
}


@pytest.mark.slow
@pytest.mark.parametrize("name", EXAMPLES)
def test_the_example_compiles_no_program_of_single_precision(name, tmp_path, caplog):
    test = EXAMPLES[name]
    test.globs |= {"kl": kl, "folder": tmp_path}
    caplog.set_level(logging.DEBUG, "jax")
    with jax.enable_x64(False), jax.log_compiles():
        done = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(test)
    assert done.attempted
    assert not done.failed
    assert not [each.getMessage() for each in caplog.records if "float32" in each.getMessage()]
