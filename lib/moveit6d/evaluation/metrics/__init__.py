"""Metrics of poses and of tracks, under the names that the field gives them.

Never reads files. `auc` and `vsd` are modules of their own.
"""

from .pose_errors import (
    ADD_LIMIT as ADD_LIMIT,
)
from .pose_errors import (
    LAVAL_DEGREES as LAVAL_DEGREES,
)
from .pose_errors import (
    LAVAL_METRES as LAVAL_METRES,
)
from .pose_errors import (
    LAVAL_PATIENCE as LAVAL_PATIENCE,
)
from .pose_errors import (
    LOST_RUN as LOST_RUN,
)
from .pose_errors import (
    ErrorFunction as ErrorFunction,
)
from .pose_errors import (
    accuracy as accuracy,
)
from .pose_errors import (
    add as add,
)
from .pose_errors import (
    add_s as add_s,
)
from .pose_errors import (
    adi as adi,
)
from .pose_errors import (
    auroc as auroc,
)
from .pose_errors import (
    errors_of as errors_of,
)
from .pose_errors import (
    flattened as flattened,
)
from .pose_errors import (
    frames_until_lost as frames_until_lost,
)
from .pose_errors import (
    laval_failures as laval_failures,
)
from .pose_errors import (
    laval_rotation_error as laval_rotation_error,
)
from .pose_errors import (
    laval_stability as laval_stability,
)
from .pose_errors import (
    mspd as mspd,
)
from .pose_errors import (
    mssd as mssd,
)
from .pose_errors import (
    reprojection_error as reprojection_error,
)
from .pose_errors import (
    rotation_error as rotation_error,
)
from .pose_errors import (
    stability as stability,
)
from .pose_errors import (
    translation_error as translation_error,
)
from .pose_errors import (
    within as within,
)
