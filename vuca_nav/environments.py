"""The gymnasium environments, by a name that no script shadows.

``gymnasium.make("vuca_nav.environments:vuca/Navigation-v0")`` and
``gymnasium.make_vec("vuca_nav.environments:vuca/Arena-v0", num_envs=8)`` work beside a ``train.py`` of one's own, too.

Raises:
    Shadowed: On import, if the program has imported a module called ``robots``, ``train`` or ``worlds`` of its own.
"""

from vuca_nav.own_packages import import_own

import_own("robots.gym_env")
import_own("train.arena.gym_env")
