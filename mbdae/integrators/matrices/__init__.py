"""The iteration matrix of implicit methods: scaled, ordered, factorised."""
