"""README.txt of a bundle."""

README_TEXT = """\
A capture session of a projection dome, bundled by procam.

To solve it again:

    procam venue unpack THIS.zip NEW-VENUE
    procam session solve NEW-VENUE/sessions/0001

The maps are the same to the last bit as those of the venue it is from, with the same versions of procam
and its libraries. No device is needed.

manifest.json           schema, size and sha256 of each file, and what of the venue was left out
venue.toml              the screen, the devices and the marks on the dome, with units in the names
masks/, responses/      files that venue.toml names
sessions/0001/          plan.json, the patterns that were shown, and the photographs with their index:
                        16-bit TIFF, linear counts of the camera, by camera, shot and exposure in seconds
original/               feedback, albedo and figures of the calibration solved at the venue, if there was one;
                        they must come out again
"""
