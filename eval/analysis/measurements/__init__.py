"""Measurements that rows of episodes do not give: of critics, gates, courses and last avoidable moments."""
