"""Contact laws, one per file: normal laws, and the pin in its race that uses them."""

from mbdae.contact.hertz import Hertz
from mbdae.contact.journal import JournalContact
from mbdae.contact.normal import Normal

__all__ = ["Hertz", "JournalContact", "Normal"]
