"""The parts of run.py: what is built, which logs, who competes, how it is measured, what is written."""
