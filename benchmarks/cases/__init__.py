"""Cases of the benchmarks, one module a question."""
