"""Compiled kernels of derived laws, trees and line elements."""

from mbdae.kernels.compile import Kernel
from mbdae.kernels.plan import LinearisedPlan, Plan, linearised_plan, plan

__all__ = ["Kernel", "LinearisedPlan", "Plan", "linearised_plan", "plan"]
