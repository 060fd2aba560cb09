"""Line charts as SVG text: colours come from the style sheet of the page that they stand in."""
