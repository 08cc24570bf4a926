from framework.proofs.assembly_modes import AssemblyMode, AssemblyModes, assembly_modes
from framework.proofs.homotopy import PathCount
from framework.proofs.regular_ball import prove_regular_ball
from framework.proofs.singular_paving import PavedSet, SingularPaving, pave_singularities
from framework.proofs.working_modes import WorkingMode, WorkingModes, working_modes

__all__ = [
    "AssemblyMode",
    "AssemblyModes",
    "PathCount",
    "PavedSet",
    "SingularPaving",
    "WorkingMode",
    "WorkingModes",
    "assembly_modes",
    "pave_singularities",
    "prove_regular_ball",
    "working_modes",
]
