"""The stage: the mannequin, performers who are not the rig, performances and takes with known truth."""
