"""What a run measures beside frames and history: one class a kind, over the functions of `jaxdem.observables`."""
