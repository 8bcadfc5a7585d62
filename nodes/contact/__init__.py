"""Normal contact of fingertip and tissue. Each class is found by its name in any file of this folder."""

from palpate.nodes.base.room import room
from palpate.nodes.contact.series import Series

__all__ = ["Series"]

__getattr__, __dir__ = room(__name__)
