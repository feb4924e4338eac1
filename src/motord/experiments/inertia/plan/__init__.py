"""The plans: releases of a bar between springs, and steps of the motor's own torque."""
