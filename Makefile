# Everything a person or a machine does with this project starts here; `make` lists it.

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
MAKEFLAGS += --no-print-directory
# Without compiled modules every start of every process takes seconds longer.
unexport PYTHONDONTWRITEBYTECODE

export PATH := $(CURDIR)/.venv/bin:$(PATH)
PY := .venv/bin/python
PYTEST_ARGS ?=
SEED ?= 0
RUN_OPTIONS = $(foreach name,LAB BIND PORT SPEED EDGE,$(if $($(name)),--$(call lower,$(name)) '$($(name))'))
lower = $(shell echo '$(1)' | tr A-Z a-z)

# Set-up is done once per content of the lock files.
hash = $(shell cat $(wildcard $(1)) | sha256sum | cut -c1-16)
PYTHON_READY := .venv/.ready-$(call hash,pyproject.toml uv.lock)
NODE_READY := frontend/node_modules/.ready-$(call hash,frontend/package.json frontend/package-lock.json)
PAGES_READY := frontend/node_modules/.built
HAS_FRONTEND := $(wildcard frontend/package.json)
HAS_E2E := $(wildcard tests/e2e)
FRONTEND_SOURCES = $(shell find frontend -type f -not -path '*/node_modules/*' -not -path '*/dist/*')

.PHONY: help
help: ## list these targets
	@echo "labweb: an operating system for autonomous laboratories"
	@grep -hE '^[a-z0-9-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z0-9-]+):.*## (.*)/\1|\2/' | awk -F'|' '{printf "  make %-14s %s\n", $$1, $$2}'
	@echo
	@echo "  make run LAB=file [BIND=file] [PORT=8400] [SPEED=10] [EDGE=0.0.0.0:8443]    open another lab"
	@echo "  make test PYTEST_ARGS='-n 2 -k transfer'     pass words to pytest"

.PHONY: run
run: setup ## install, build, migrate, seed, start; prints address, user and password
	@exec $(PY) -m deploy.embedded run $(RUN_OPTIONS)

.PHONY: dev
dev: setup ## the same, with pages that reload as you edit them, at http://127.0.0.1:5173
	@trap 'kill 0' EXIT; $(PY) -m deploy.embedded run $(RUN_OPTIONS) & \
	    LABWEB_URL=http://127.0.0.1:$(or $(PORT),8400) npm --prefix frontend run dev

.PHONY: test
test: setup browser ## install; every check and every test: Python, TypeScript, browser
	@bash deploy/setup/test $(PYTEST_ARGS)

.PHONY: test-domain
test-domain: $(PYTHON_READY) ## the rules alone, in seconds; run it on every save
	@$(PY) -m pytest -c tests/domain/pytest.ini --confcutdir=tests tests/domain $(PYTEST_ARGS)

.PHONY: test-services
test-services: setup ## server and system tests on PostgreSQL, Redis and RabbitMQ of this machine
	@bash deploy/setup/services $(PYTEST_ARGS)

.PHONY: check
check: setup ## format, lint, types, contracts, catalog, migrations, lock, generated files
	@bash deploy/setup/check

.PHONY: fix
fix: setup ## mend what can be mended by itself
	@ruff check --fix .
	@ruff format .
	@$(if $(HAS_FRONTEND),npm --prefix frontend run --if-present fix,true)

.PHONY: generate
generate: setup ## REST schema and messages to TypeScript, driver table to docs
	@bash deploy/setup/generate

.PHONY: driver
driver: setup ## begin a driver, its simulator and its test: NAME=acme_pump ROLE=pump TRANSPORT=serial
	@$(PY) -m drivers.new $(if $(CLASS),--class '$(CLASS)') $(if $(TITLE),--title '$(TITLE)') \
	    --role '$(ROLE)' --transport '$(TRANSPORT)' -- '$(NAME)'
	@bash deploy/setup/generate

.PHONY: bench
bench: setup ## the benchmarks: each figure of the README beside its limit
	@$(PY) -m benchmarks

.PHONY: soak
soak: setup browser ## the tests with full counts (SEED=0); the record goes to docs/figures
	@bash deploy/setup/soak '$(SEED)' $(PYTEST_ARGS)

.PHONY: setup
setup: $(PYTHON_READY) $(if $(HAS_FRONTEND),$(PAGES_READY)) ## only install and build
	@:

.PHONY: browser
browser:
	@$(if $(HAS_E2E),bash deploy/setup/browser,true)

$(PYTHON_READY):
	@bash deploy/setup/python
	@rm -f .venv/.ready-*; touch $@

$(NODE_READY):
	@bash deploy/setup/node
	@rm -f frontend/node_modules/.ready-*; touch $@

ifneq ($(HAS_FRONTEND),)
$(PAGES_READY): $(NODE_READY) $(FRONTEND_SOURCES)
	@echo "Building the pages"
	@npm --prefix frontend run --silent build
	@touch $@
endif
