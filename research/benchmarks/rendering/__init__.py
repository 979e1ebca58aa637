"""The accuracy and the speed of the VTK renderer."""
