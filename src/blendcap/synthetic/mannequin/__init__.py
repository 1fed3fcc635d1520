"""The mannequin: a head made by our own code, the rig that comes with blendcap.

An authored cage of anthropometric points (`points`, `cage`) is moved into a person (`measures`, `identity`) and into
shapes (`jaw`, `lips`, `lids`, `upper_face`, `shapes`), subdivided by one linear map (`subdivision`), completed by eyes,
teeth and tongue (`parts`) and painted (`atlas`, `skin`).
"""

from blendcap.synthetic.mannequin.asymmetry import ASYMMETRIES
from blendcap.synthetic.mannequin.build import mannequin
from blendcap.synthetic.mannequin.identity import PEOPLE
from blendcap.synthetic.mannequin.measures import MEASURES

__all__ = ["ASYMMETRIES", "MEASURES", "PEOPLE", "mannequin"]
