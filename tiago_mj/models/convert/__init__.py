"""From URDF to MJCF: read, diagnose, repair, fit, add, write.

Modules in the order of the flow: ``xml_lines`` and ``urdf`` (read), ``tree`` (diagnose), ``inertia`` (repair),
``meshes`` and ``primitives`` (shapes), ``extras`` (additions file), ``urdf_to_mjcf`` (assembly), ``command``
(``tiago-mj convert``).
"""

from tiago_mj.models.convert.assembly import Options
from tiago_mj.models.convert.errors import ConversionError
from tiago_mj.models.convert.inertia import InertiaRepair
from tiago_mj.models.convert.report import ConversionReport, FittedShape
from tiago_mj.models.convert.urdf_to_mjcf import convert

__all__ = ["ConversionError", "ConversionReport", "FittedShape", "InertiaRepair", "Options", "convert"]
