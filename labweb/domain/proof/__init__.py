"""Carry out a compiled plan on paper and prove, or refuse to prove, what it claims.

Nothing here knows the compiler: a plan is read, executed action by action on the physical graph,
and its claims are compared with what came of it. The format is `docs/plan.md`.
"""
