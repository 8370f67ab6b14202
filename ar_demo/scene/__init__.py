"""What the scene does to a surface: light, blur, occluders."""
