"""Contact laws, one per file: normal laws, and the pin in its race that uses them."""

from mbdae.laws.contact.hertz import Hertz
from mbdae.laws.contact.journal import JournalContact
from mbdae.laws.contact.normal import Normal

__all__ = ["Hertz", "JournalContact", "Normal"]
