"""What a radar gets back from bodies of any shape: shooting and bouncing rays, volumes, rough ground."""
