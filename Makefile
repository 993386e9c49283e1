# `make demo` and `make test` need Rust, Python 3.10 or newer and nothing else: they make .venv themselves.
SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
# What the tests need, and what a demonstration does: .venv grows when it is asked for more.
EXTRAS := train,tune,data,lab,render,remote,ray,export,dev
demo: EXTRAS := train
# Extra arguments of the program: make demo ARGS="--steps 100000"
ARGS ?=

export VIRTUAL_ENV := $(CURDIR)/$(VENV)
export PIP_DISABLE_PIP_VERSION_CHECK := 1

# Seconds of each fuzz target, minutes of the soak.
FUZZ_SECONDS ?= 600
SOAK_MINUTES ?= 30

.PHONY: help demo test lint lint-rust lint-python lint-workflows test-rust test-python test-oldest extension bench scores controllers clean
.PHONY: venv set-up docs packages neighbours
.PHONY: server test-remote bench-remote soak fuzz ray bench-ray

help: ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-12s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

demo: extension ## train three agents, compare them with the LQR, write runs/demo/report.html
	$(BIN)/rodgym demo $(ARGS)

# The site in site/, from docs/ and the docstrings; the crates' reference in site/rust. An environment
# of its own: the generator is no dependency of anything else.
DOCS := .venv-docs
DOC_CRATES := rodgym-core rodgym-baselines rodgym-render rodgym-server
docs: $(DOCS)/.ready ## the documentation site in site/: strict, offline, every link checked
	$(DOCS)/bin/zensical build --strict --clean
	RUSTDOCFLAGS="-D warnings" cargo doc --no-deps $(addprefix --package ,$(DOC_CRATES))
	rm -rf site/rust && cp -r target/doc site/rust
	$(DOCS)/bin/python docs/check_site.py site

$(DOCS)/.ready: docs/requirements.txt
	$(PYTHON) -m venv $(DOCS)
	$(DOCS)/bin/python -m pip install --quiet -r docs/requirements.txt
	touch $@

# Wheel and source archive in dist/, each installed in a fresh environment and tried there.
packages: venv ## wheel and sdist, built and tried in fresh environments, each extra alone
	$(BIN)/python tests/long/packages.py

.PHONY: crates
crates: ## what `cargo publish` would send, compiled as others would compile it
	cargo publish --dry-run --package rodgym-core --package rodgym-baselines

# Libraries that others train and store episodes with, in an environment of its own.
NEIGHBOURS := .venv-neighbours
neighbours: extension $(NEIGHBOURS)/.ready ## TorchRL, Minari, tianshou, skrl, rl_zoo3 over these environments
	RODGYM_NEED_NEIGHBOURS=1 PYTHONPATH=py-bindings/python $(NEIGHBOURS)/bin/python -m pytest -rs \
		tests/python/test_neighbours.py

$(NEIGHBOURS)/.ready: tests/neighbours.txt
	$(PYTHON) -m venv $(NEIGHBOURS)
	$(NEIGHBOURS)/bin/python -m pip install --quiet -r tests/neighbours.txt
	touch $@

# A benchmark of rod solvers that others keep, with the solvers that it brings.
COSSERAT := .venv-cosseratbench
.PHONY: cosseratbench
cosseratbench: extension $(COSSERAT)/.ready ## cosseratbench's planar cases, here and by others: writes docs/performance/cosseratbench.md
	OMP_NUM_THREADS=1 PYTHONPATH=py-bindings/python $(COSSERAT)/bin/python tests/long/cosserat.py

$(COSSERAT)/.ready: tests/cosseratbench.txt
	$(PYTHON) -m venv $(COSSERAT)
	$(COSSERAT)/bin/python -m pip install --quiet -r tests/cosseratbench.txt
	touch $@

test: lint test-rust test-oldest test-python ## everything that must hold before a change lands
# One extension for all of it, the one with the server; linters see its code too. (Without: `default` keeps
# the features of pyproject.toml out, which would compile libzmq for a demo.)
test lint server: FEATURES := --features server

lint: lint-rust lint-python lint-workflows ## formats, clippy, ruff, mypy, workflows

# (The bindings are built for the environment's Python, and once: the library of them has the same sources.)
lint-rust: venv
	cargo fmt --all --check
	cargo clippy --workspace --exclude rodgym-bindings --exclude own-task-wheel --all-targets $(FEATURES) -- -D warnings

lint-python: extension
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# (shellcheck reads the scripts inside the workflows.)
lint-workflows: venv
	$(BIN)/jactionlint --strict-exit --shellcheck=$(BIN)/shellcheck

# With FEATURES (so in `make test`) also what needs libzmq: CURVE, the program, its signals.
test-rust:
	cargo test $(if $(FEATURES),--features rodgym-server/zmq)

# Last, so that the last line is pytest's verdict.
test-python: server
	RODGYM_NEED_SERVER=1 $(BIN)/python -m pytest

# The oldest Gymnasium that is supported, beside the newest in $(VENV); only what touches it.
OLDEST := .venv-oldest
test-oldest: extension $(OLDEST)/.ready
	PYTHONPATH=py-bindings/python $(OLDEST)/bin/python -m pytest tests/python/test_env.py \
		tests/python/test_vector.py tests/python/test_errors.py

$(OLDEST)/.ready:
	$(PYTHON) -m venv $(OLDEST)
	$(OLDEST)/bin/python -m pip install --quiet gymnasium==1.1.0 numpy pygame pytest
	touch $@

server: extension ## the extension with the network server: compiles libzmq once

test-remote: server ## the network: faults, keys, other languages' clients
	RODGYM_NEED_SERVER=1 $(BIN)/python -m pytest tests/python -k remote

bench-remote: server ## the network's speed against an echo: refreshes docs/performance/remote.md
	PYTHONPATH=tests/python $(BIN)/python tests/long/remote_bench.py --page docs/performance/remote.md

soak: server ## long: 32 clients for SOAK_MINUTES, then a connection cut at every byte
	PYTHONPATH=tests/python $(BIN)/python tests/long/remote_soak.py --minutes $(SOAK_MINUTES)
	PYTHONPATH=tests/python $(BIN)/python tests/long/remote_cuts.py

.PHONY: soak-fin
soak-fin: extension ## long: a million random steps of every fin, writes docs/fin-soak.md
	$(BIN)/python tests/long/fin_soak.py

fuzz: ## long: FUZZ_SECONDS of each target (needs nightly Rust and cargo-fuzz)
	@cargo +nightly fuzz --version || { echo "rustup toolchain install nightly && cargo install cargo-fuzz"; exit 1; }
	$(PYTHON) env-server/fuzz/seed.py
	cd env-server && for target in header machine peer; do \
	  cargo +nightly fuzz run --codegen-units 16 $$target -- -max_total_time=$(FUZZ_SECONDS) -max_len=20000 -rss_limit_mb=2048 \
	    -print_final_stats=1; \
	done

# RLlib has an environment of its own, because it pins Gymnasium.
RLLIB := .venv-rllib
ray: export RODGYM_NEED_RAY := 1
ray: export RODGYM_NEED_SERVER := 1
ray: server $(RLLIB)/.ready ## long: RLlib, and studies on Ray clusters that the tests start (makes .venv-rllib)
	$(BIN)/python -m pytest tests/python/test_ray.py
	PYTHONPATH=py-bindings/python $(RLLIB)/bin/python -m pytest -k "not study and not killed" \
		tests/python/test_ray.py tests/python/test_rllib.py

$(RLLIB)/.ready:
	$(PYTHON) -m venv $(RLLIB)
	$(RLLIB)/bin/python -m pip install --quiet 'ray[rllib]>=2.60,<3' torch pyyaml pyzmq msgpack pytest
	touch $@

bench-ray: extension ## long: a study on one worker and on two
	$(BIN)/python tests/long/ray_bench.py

bench: extension ## speed beside other simulators (installed ones): refreshes docs/performance/
	$(BIN)/rodgym bench --runs docs --name performance $(ARGS)

.PHONY: accuracy
accuracy: venv ## long: how exact every stepper is; writes the table of default steps and docs/performance/accuracy.md
	cargo build --release -p rodgym-core --example swing
	PYTHONPATH=tests/python $(BIN)/python tests/long/accuracy.py

.PHONY: soak-pendulum
soak-pendulum: ## long: a million random torques on ordinary rods, and on soft and thin ones
	cargo test --release -p rodgym-core --test accuracy -- --ignored --nocapture

controllers: extension ## long: every claim of the controllers on 100 seeds, writes docs/controllers.md
	$(BIN)/python tests/long/controllers.py

.PHONY: lab
lab: extension ## long: fits of 1300 synthetic films and 120 fins, writes docs/lab-proofs.md; goes on where it was stopped
	OMP_NUM_THREADS=1 $(BIN)/python tests/long/lab.py

.PHONY: unknown-rods
unknown-rods: extension ## long: output feedback of rods that it must learn, writes docs/unknown-rods.md
	$(BIN)/python tests/long/unknown_rods.py

.PHONY: gaits
gaits: extension ## long: a minute; gaits of fins whose stiffness is felt, writes docs/gaits.md
	$(BIN)/python tests/long/gaits.py

scores: extension ## long: trains on several seeds and writes docs/scores.md
	$(BIN)/python tests/long/scores.py

.PHONY: kept-seeds
kept-seeds: extension ## long: tests a claim on seeds that nobody looked at, once (tests/data/kept_seeds.json)
	$(BIN)/python tests/long/kept_seeds.py

.PHONY: benchmark
benchmark: extension ## long, hours: every learner and controller on every task, writes docs/benchmark.md
	$(BIN)/python tests/long/benchmark.py

.PHONY: robustness
robustness: extension ## long: how far off rod, motor and sensors may be; refreshes docs/robustness.md
	$(BIN)/python tests/long/robustness.py

.PHONY: best-known
best-known: extension ## long: searches for the best known actions of every width, writes docs/best-known.md; goes on where it was stopped
	OMP_NUM_THREADS=1 $(BIN)/python tests/long/best_known.py

.PHONY: distil
distil: extension ## long: ten students of each recipe, writes the table of docs/distillation.md
	$(BIN)/python tests/long/distil.py

# A terminal sees cargo's progress; elsewhere what the build says is shown when it fails.
extension: venv
	@if [ -t 2 ]; then \
		echo "building the extension (the first time some 2 to 8 minutes of two cores; then what has changed) ..."; \
		$(BIN)/maturin develop --release $(or $(FEATURES),--features default); \
	else \
		echo "building the extension ..."; \
		$(BIN)/maturin develop --release --quiet $(or $(FEATURES),--features default) > $(VENV)/build.log 2>&1 \
			|| { cat $(VENV)/build.log >&2; exit 1; }; \
	fi

# The environment is made once, and again when the project's dependencies change (by their text:
# in a fresh clone every file is new) or when more extras are wanted than it has.
READY := $(VENV)/.ready
venv:
	@cmp -s pyproject.toml $(READY) && { test ! -e $(READY)-extras || grep -qxE '$(EXTRAS)|.*dev' $(READY)-extras; } \
		|| $(MAKE) --no-print-directory set-up EXTRAS=$(EXTRAS)

set-up:
	@echo "setting up $(VENV) (once; downloads PyTorch) ..."; began=$$SECONDS; \
	$(PYTHON) -m venv $(VENV); \
	$(BIN)/python -m pip install --quiet 'maturin>=1.9,<2'; \
	quiet=--quiet; if [ -t 2 ]; then quiet=; fi; \
	$(BIN)/maturin develop --release $$quiet --features default --extras $(EXTRAS); \
	cp pyproject.toml $(READY); echo '$(EXTRAS)' > $(READY)-extras; \
	echo "set-up took $$((SECONDS - began)) s"

clean: ## removes what was built and the runs, not the virtual environment
	cargo clean
	rm -rf runs dist site .cache .pytest_cache .mypy_cache .ruff_cache
	find . -name __pycache__ -not -path './$(VENV)/*' -prune -exec rm -rf {} +
