//! Nothing but tests: see `tests/`. The recordings are in `recordings/`.
