"""The table of `make mutants` stays true of the files that it changes."""

from __future__ import annotations

import pytest
from mutants import MUTANTS, ROOT, Mutant, changed


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: f"{mutant.file}: {mutant.after}")
def test_a_mutant_has_its_place_once_and_tests_that_exist(mutant: Mutant) -> None:
    assert mutant.after in changed(mutant, ROOT)
    assert all((ROOT / test).exists() for test in mutant.tests)
