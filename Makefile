# The two main commands are `make report` and `make test`. Both make their own environment.
# 3.11 where it is, as only that has wheels of PyBullet; else the newest of the others.
ifndef PYTHON
PYTHON := $(firstword $(foreach v,3.11 3.14 3.13 3.12,$(shell python$(v) -c "import venv" 2>/dev/null && echo python$(v))))
endif
unexport PYTHONDONTWRITEBYTECODE  # the tests start hundreds of processes: each would compile all that it imports
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
COMPILED := $(VENV)/.compiled
REPORTING := $(VENV)/.reporting
LOWEST := .venv-lowest
NEWEST := .venv-newest
MODELS := .venv-models
MUJOCOS := 3.5.0 3.6.0 3.7.0 3.8.0 3.9.0 3.10.0 3.11.0  # beside the installed one
ENGINES := .venv-engines
# A tester waits a quarter of its time for processes that tests start: three keep two cores at work.
TESTERS := 3
# A file's tests share what it computes. Files come as tests/conftest.py sorts them, not those of most tests first.
BY_FILE := --dist loadfile --no-loadscope-reorder
COMPILE = $(BIN)/uv pip compile pyproject.toml --universal --python-version 3.11 \
	  --generate-hashes --no-emit-index-url --no-emit-find-links --no-annotate --quiet --custom-compile-command "make lock"
# A new environment with uv of the lock, by pip, which installs the rest in a fifth of pip's time.
define NEW_ENVIRONMENT
@test -n "$(PYTHON)" || { echo "No Python 3.11 ... 3.14 is here. Install one, such as python3.11"; exit 1; }
@echo "Python: $$($(PYTHON) -c 'import sys; print(sys.version.split()[0], sys.executable)')"
@test -x $(@D)/bin/pip || $(PYTHON) -m venv $(@D)
@sed -n '/^uv==/,/[^\\]$$/p' $(filter %.txt,$^) > $(@D)/uv.txt
@$(@D)/bin/pip install --quiet --disable-pip-version-check --require-hashes -r $(@D)/uv.txt
endef
UV_INSTALL = $(@D)/bin/uv pip install --quiet --python $(@D)/bin/python

.PHONY: report test test-all test-machines test-pythons fuzz test-random docs sessions release-check mutants test-plugins test-answers answers test-searches test-lowest test-newest versions test-models test-reality test-engines bench site browse check lint types format lock clean

DIGESTS := reports/steel-1lb/hcbench-files.json
report: $(REPORTING)  ## regenerate the default report into reports/steel-1lb/, and compare it with the repository's
	$(BIN)/hcbench report steel-1lb
	@git diff --quiet HEAD -- $(DIGESTS) 2>/dev/null; case $$? in \
	  0) echo "All its files are the same bytes as in the repository.";; \
	  1) echo "Not the same bytes as in the repository:"; git diff -U0 HEAD -- $(DIGESTS) | sed -n 's/^+  "\(.*\)": .*/  \1/p';; \
	esac

test: check  ## lint, types, then every test but the long ones
	$(BIN)/python -m pytest -n $(TESTERS) $(BY_FILE)

test-all: $(INSTALLED)  ## every test that this environment can run, the long ones too
	HCBENCH_ANSWERS=1 HCBENCH_PLUGINS=1 HCBENCH_PYTHONS=1 HCBENCH_SEARCHES=1 $(BIN)/python -m pytest -n 2 $(BY_FILE)

test-machines: $(INSTALLED)  ## every test on five simulated machines: processors, threads, languages, users, paths
	PYTHONPATH=tests/support $(BIN)/python -m machines -n 2 $(BY_FILE)

test-random: $(INSTALLED)  ## the tests of properties, with a thousand random examples each in place of the same hundred
	$(BIN)/python -m pytest -n 2 -m hypothesis --hypothesis-profile=random

test-pythons: $(INSTALLED)  ## the wheel in environments of every Python of this machine, from 3.11 on
	HCBENCH_PYTHONS=1 $(BIN)/python -m pytest tests/project/test_pythons.py

fuzz: $(INSTALLED)  ## 20 000 random inputs in one process, 300 as processes, 100 signals at random times, 8 000 calls of the API, and 300 mutated files a reader
	PYTHONPATH=tests/support $(BIN)/python -m fuzz

test-plugins: $(INSTALLED)  ## the plug-ins' long measurements: energy by option, 2000 random scenes, a minute at rest
	HCBENCH_PLUGINS=1 $(BIN)/python -m pytest -q -s -n 2 tests/engines/mujoco/test_plugin_options.py \
	  tests/engines/mujoco/test_plugin_random_scenes.py tests/engines/mujoco/test_plugin_rest.py \
	  tests/engines/bullet/test_bullet_random_scenes.py

test-compilers: $(INSTALLED)  ## the plug-ins under every gcc, clang and zig of this machine, for several versions of MuJoCo
	for version in $(MUJOCOS); do \
	  test -d .mujocos/$$version/mujoco/include || \
	  $(BIN)/uv pip install --quiet --no-deps --python $(BIN)/python --target .mujocos/$$version mujoco==$$version; \
	done
	HCBENCH_MUJOCOS=$$(printf ':%s/mujoco' $(MUJOCOS:%=$(CURDIR)/.mujocos/%)) $(BIN)/python -m pytest -q \
	  tests/engines/test_compilers.py

# libstdc++ as well: an exception of MuJoCo would find no __cxa_throw behind the sanitizer's. MuJoCo's headers would
# call functions for __SANITIZE_ADDRESS__ that its own library does not have.
SANITIZED = CC="gcc -g -fsanitize=address,undefined -fno-sanitize-recover=undefined -U__SANITIZE_ADDRESS__" ASAN_OPTIONS=detect_leaks=0 \
  LD_PRELOAD="$$(gcc -print-file-name=libasan.so) $$(gcc -print-file-name=libstdc++.so.6)"
test-sanitizers: $(INSTALLED)  ## the plug-ins compiled by gcc with AddressSanitizer and UBSan: states, threads, random scenes
	$(SANITIZED) $(BIN)/python -m pytest -q -p no:cacheprovider tests/engines/mujoco/test_plugin_state.py \
	  tests/engines/mujoco/test_plugin_random_scenes.py tests/engines/mujoco/test_plugin_servos.py \
	  tests/engines/mujoco/test_plugin_robots.py tests/engines/bullet/test_contact_pybullet.py

answers: $(INSTALLED)  ## the answers that pages tell: hcbench/tuning/usual_answers.json
	$(BIN)/python -c 'from hcbench.tuning import usual, usual_errors; usual.write(); usual_errors.write()'

test-answers: $(INSTALLED)  ## every answer of that file, found again, by the command and by Python
	HCBENCH_ANSWERS=1 $(BIN)/python -m pytest -n 2 tests/tuning/test_usual_answers.py tests/tuning/test_usual_errors.py

test-searches: $(INSTALLED)  ## what tune finds in long searches, and every command of the pages in a plain model
	HCBENCH_SEARCHES=1 $(BIN)/python -m pytest -n 2 tests/tuning

test-lowest: $(LOWEST)/.installed  ## every test on the lowest versions that pyproject.toml allows
	$(LOWEST)/bin/python -m pytest -n 2 --dist loadfile  # its xdist cannot keep an order

test-newest: $(NEWEST)/.installed  ## every test on the newest versions that the package index has, not locked
	$(NEWEST)/bin/python -m pytest -n 2 $(BY_FILE)

versions: $(INSTALLED)  ## every command with each version of what hcbench needs: the tables of docs/reference/versions.md
	PYTHONPATH=tests/support $(BIN)/python -m versions

test-models: $(MODELS)/.installed  ## 60 models that others wrote, from their packages (docs/explanation/models.md), loops of our own over 32, and robots that land and are tuned
	HCBENCH_MODELS=1 $(MODELS)/bin/python -m pytest -n 2 tests/measuring/test_models_from_outside.py \
	  tests/measuring/test_outside_loops.py tests/engines/mujoco/test_plugin_landings.py \
	  tests/tuning/test_tuned_robots.py

test-reality: $(INSTALLED)  ## engines on all measured tosses and drops, and synthetic twins
	HCBENCH_REALITY=1 $(BIN)/python -m pytest -n 2 tests/reality

test-engines: $(INSTALLED)  ## tests of all engines from the package index, each in an environment of its own
	HCBENCH_DATA=$(abspath $(ENGINES)) $(BIN)/hcbench engines add mujoco@3.3.0 mujoco@3.6.0 \
	  $$($(BIN)/python -c "from hcbench.sim.install import names; print(*names())")
	if command -v npm >/dev/null; then npm install --silent --prefix $(ENGINES)/node jolt-physics@1.1.0; fi
	HCBENCH_ENGINES=$(abspath $(ENGINES)) $(BIN)/python -m pytest -n 2 --dist loadgroup \
	  tests/sim/test_engines_from_index.py tests/engines/test_steps_of_robots.py tests/engines/test_mjx_warp.py tests/engines/test_worlds_loaded.py tests/engines/test_newton.py tests/engines/test_physx.py \
	  tests/engines/test_opensim.py tests/reporting/test_field.py tests/cases

bench: $(INSTALLED)  ## every speed claim, measured against the alternatives; updates benchmarks/README.md
	$(BIN)/python -m pytest benchmarks/bench_reference.py benchmarks/bench_engines.py benchmarks/bench_commands.py \
	  --benchmark-json=benchmarks/last.json
	$(BIN)/python benchmarks/table.py benchmarks/last.json

docs: $(INSTALLED)  ## the documentation, into docs/_build/html
	rm -rf docs/_build  # what an earlier build read, this one would not warn of
	$(BIN)/python -m sphinx -q -W --keep-going docs docs/_build/html
	rm -rf docs/_build/reports && cp -R reports docs/_build/  # a link here would end the search for files of a package
	sed -i.md -E 's|"../../docs/([^"]*).md"|"../../html/\1.html"|g' docs/_build/reports/*/index.html
	rm docs/_build/reports/*/*.md

sessions: $(INSTALLED)  ## the outputs that pages show, written again: the blocks of `$$ command` in README, examples and docs
	PYTHONPATH=tests/support $(BIN)/python -m sessions

release-check: $(INSTALLED)  ## build, check the files with the package index's tools, and say what a release still lacks
	PYTHONPATH=tests/support $(BIN)/python -m release_check

mutants: $(INSTALLED)  ## small changes of the physics in a copy, one by one: the tests of the room must notice each
	PYTHONPATH=tests/support $(BIN)/python -m mutants $(WORDS)

site: docs  ## the documentation and the reports in one folder, site/, that any static host takes
	$(BIN)/python docs/site_folder.py docs/_build/html site

browse: site  ## every page of the site in Chromium, wide, on a phone and in the dark, with axe-core
	PYTHONPATH=tests/support $(BIN)/python -m browse site

check: $(INSTALLED)  ## the documentation, lint and types, side by side; in a new environment the tests are compiled, too
	+@$(MAKE) --no-print-directory -j3 docs lint types $(COMPILED)

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(INSTALLED)
	$(BIN)/mypy

$(COMPILED): $(INSTALLED)  # once, in place of once in each tester
	$(BIN)/python -m pytest --collect-only --quiet >/dev/null
	touch $@

format: $(INSTALLED)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

lock:  ## refresh the locked dependencies: the newest for development, and the lowest allowed
	$(COMPILE) --extra dev --output-file requirements-dev.txt
	$(COMPILE) --constraint requirements-dev.txt --output-file requirements-report.txt
	$(COMPILE) --extra dev --resolution lowest-direct --output-file requirements-lowest.txt

$(REPORTING): requirements-report.txt
$(INSTALLED): requirements-dev.txt
$(LOWEST)/.installed: requirements-lowest.txt
$(REPORTING) $(INSTALLED) $(LOWEST)/.installed: pyproject.toml
	$(NEW_ENVIRONMENT)
	$(UV_INSTALL) --require-hashes -r $(filter %.txt,$^)
	$(UV_INSTALL) --no-deps --editable .
	touch $@

$(NEWEST)/.installed: pyproject.toml
	$(PYTHON) -m venv $(@D)
	$(@D)/bin/pip install --quiet --disable-pip-version-check --upgrade --editable '.[dev]'
	touch $@

$(MODELS)/.installed: pyproject.toml
	$(PYTHON) -m venv $(@D)
	$(@D)/bin/pip install --quiet --disable-pip-version-check --editable '.[dev]' \
	  'gymnasium[mujoco]' gymnasium-robotics dm_control
	$(@D)/bin/pip install --quiet --disable-pip-version-check --no-deps metaworld robosuite gym-aloha gym-xarm gym-hil safety-gymnasium brax playground
	touch $@

clean:
	rm -rf $(VENV) $(LOWEST) $(NEWEST) $(MODELS) .venv-versions .mujocos .pytest_cache .mypy_cache .ruff_cache
