"""From the testbed to a robot: the bundle, what checks it, and what drives a robot by it. No simulator here."""
