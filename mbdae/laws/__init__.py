"""The laws that mbdae ships, one per file: joints, forces, contact, friction, elements.

"Paper Eq. n" in their texts is equation n of "Modified models for revolute joints coupling flexibility of links in multibody
systems", of which several are corrected: validation/paper/ of a checkout has them with their derivation.
"""
