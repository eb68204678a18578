"""Photographs that a workflow asks for: taken by devices that procam drives, or by people, in rounds.

A workflow says what shall be shown and how long exposed (`Wanted`), and a `Photographer` gives the
photograph; `open` has that of a venue. `driven` shows and photographs. The one by hand writes the pictures to
disk (`rounds`) and stops the workflow; when their photographs are stored (`receive`) it runs again from its
beginning, and finds them.
"""
