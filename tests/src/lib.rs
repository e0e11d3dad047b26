//! Whole-system tests of covista; the tests are under `tests/system`.
//!
//! *Architecture invariant:* no crate depends on this one, and it reaches covista only through the
//! binary and the files of the repository.
