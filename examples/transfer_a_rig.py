"""Every shape of a template rig on another face: transferred with contact kept, beside the papers' plain transfer."""

import blendcap
from blendcap.modeling.contacts import gaps
from blendcap.modeling.transfer import transfer

template = blendcap.mannequin(shapes=52)
person = blendcap.mannequin(2, shapes=52)  # somebody whose own rig is known; only the neutral is given away

kept = transfer(template, person.mesh)
plain = transfer(template, person.mesh, method="paper")
print(f"the person is {kept.scale:.3f} times as large; the linear solves are exact to {kept.residual:.0e}")

for name, contact in (("eyeBlinkLeft", "lids_left"), ("mouthSmileLeft", "lips"), ("mouthPressLeft", "lips")):
    pairs, shape = template.contacts[contact], template.index(name)
    widest = [gaps(rig.mesh.vertices + rig.deltas[shape], pairs).max() for rig in (template, plain.rig, kept.rig)]
    print(
        f"{name:<16}{contact:<10} widest gap: template {widest[0]:.2f}, plain {widest[1]:.2f}, kept {widest[2]:.2f} mm"
    )
    assert widest[2] < widest[0] + 0.05
