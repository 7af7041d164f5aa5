"""Reading files that anyone may have written: text, JSON, TOML and HDF5 within limits."""
