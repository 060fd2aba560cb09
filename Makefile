.PHONY: help dev fmt lint test-rust test-registers instructions docs test check bench soak soak-tests fuzz mutants asan
.PHONY: valgrind coverage audit advisories wheel matrix sdist reproducible publish

PYTHON ?= python
HOST = $(shell rustc -vV | sed -n 's/^host: //p')
# Tests that count farther with ALGDIFF_SOAK=1.
SOAKED = $(shell grep -l 'soak(' tests/test_*.py)

help: ## list the targets
	@grep -E '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed 's/:[^#]*## /~/' | column -t -s~

dev: ## install the package and all tools into the current environment
	$(PYTHON) -m pip install '.[test,lint,demo,bench,docs]'

fmt: ## format Rust and Python
	cargo fmt --all
	ruff format .
	ruff check --fix .

lint: ## formatters, linters, types and stubs; needs `make dev`
	cargo fmt --all --check
	cargo clippy --workspace --release --all-targets -- --deny warnings
	ruff format --check .
	ruff check .
	mypy
	cd tests && $(PYTHON) -m mypy.stubtest algdiff --ignore-disjoint-bases --mypy-config-file ../pyproject.toml

# The unit tests are compiled without optimisation, which takes a quarter of the time; what users get is tested by the rest.
test-rust: ## tests of the core
	cargo test --workspace --release --lib --config 'profile.release.package.algdiff-core.opt-level=0' \
	    --config 'profile.release.package.algdiff-py.opt-level=0'
	cargo test --workspace --release --test parts --test properties --test stream
	cargo test --workspace --release --doc
	cargo run --release --example control_loop

test-registers: ## the engines on registers of other CPUs as well; takes minutes to compile
	cargo test --package algdiff-core --release --lib --features emulated-registers engine

instructions: ## instructions that fixed workloads take, against those on record; needs valgrind
	$(PYTHON) tools/instructions.py

docs: ## the documentation in build/docs: examples run, links are checked, warnings are errors; needs `make dev`
	rm -rf build/docs
	$(PYTHON) -m sphinx -W --keep-going --quiet -b html docs build/docs
	ALGDIFF_DOCS=build/docs $(PYTHON) -m pytest -q tests/test_docs.py

test: ## the README's test command: install, then test
	$(PYTHON) -m pip install '.[test]' && $(PYTHON) -m pytest -n auto --dist loadfile --no-loadscope-reorder

check: dev ## all that continuous integration does
	$(MAKE) --no-print-directory --jobs 3 $(if $(filter output-sync,$(.FEATURES)),--output-sync=target) lint test-rust docs
	$(MAKE) --no-print-directory test

bench: ## speed against the targets and the peers, and the choice of the engine; results are checked first
	$(PYTHON) benches/peers.py
	$(PYTHON) benches/engines.py --strict

soak: soak-tests fuzz mutants asan valgrind coverage ## long runs, hours: all of the following; their figures are in docs/long-runs.md

soak-tests: ## the searching tests with large numbers; streams and killed runs of files
	PROPTEST_CASES=25000 cargo test --workspace --release --test properties
	ALGDIFF_SOAK=1 $(PYTHON) -m pytest -q $(SOAKED)
	$(PYTHON) benches/soak.py

fuzz: ## ten million executions of every fuzz target; needs cargo-fuzz and atheris
	$(PYTHON) fuzz/run.py

mutants: ## does a test fail for every fault that is put into the core
	$(PYTHON) tools/mutants.py

asan: ## the core's tests under AddressSanitizer; needs a C compiler
	RUSTC_BOOTSTRAP=1 RUSTFLAGS=-Zsanitizer=address cargo test --package algdiff-core --release --lib \
	    --test parts --test properties --test stream --target $(HOST) --target-dir build/asan

valgrind: ## every part of the installed package under valgrind
	$(PYTHON) tools/valgrind.py

coverage: ## the share of lines that tests reach, in Rust and Python; needs the compiler's llvm-tools
	$(PYTHON) tools/coverage.py

# What follows goes into a release, or builds one, and needs tools/requirements.txt: RELEASE.md.

audit: ## the crates that go into a wheel: how many, from where, under which licences; needs cargo-deny
	$(PYTHON) tools/audit.py

advisories: ## known vulnerabilities of crates; needs cargo-deny and the network
	cargo deny --locked check advisories

wheel: ## the wheel that is published, in dist/, audited
	$(PYTHON) tools/wheel.py $(if $(TAG),--tag $(TAG))

matrix: ## quick tests of that wheel on every CPython there is, with NumPy old and new; WANT says which must be there
	$(PYTHON) tools/matrix.py $(if $(WANT),--want $(WANT))

sdist: ## the source distribution in dist/, installed where there is nothing but Cargo
	$(PYTHON) tools/sdist.py

reproducible: ## wheel and source distribution built twice, and compared bit by bit
	$(PYTHON) tools/reproducible.py

publish: ## upload what is in dist/: only the hosted workflow may
	$(PYTHON) -m twine upload --non-interactive dist/*
